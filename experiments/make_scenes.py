"""The derived numbers of ``scenes/gloss.xml``: plates that show the lights to the eye, lights of equal power.

``python experiments/make_scenes.py`` writes them into the scene, between the two comments that mark them; with
``--check`` it only compares, and exits with 1 where the scene has other numbers. Each plate's normal is the half vector
of the directions to the eye and to the row of lights, so that the plate's middle mirrors the lights (VeachGuibas1995);
where the plates lie, and the radii, are our own choice.
"""

import sys
from pathlib import Path

import numpy as np

SCENE = Path(__file__).parents[1] / "scenes" / "gloss.xml"
BEGIN, END = "    <!-- derived numbers -->\n", "    <!-- end of the derived numbers -->\n"
EYE = np.array([0.0, 2.0, 15.0])
RADII = (0.1, 0.2, 0.4, 0.8)
LIGHTS_X = (-3.3, -1.4, 0.7, 3.0)  # at y = z = 0
TINTS = ((1.5, 0.9, 0.6), (1.3, 1.2, 0.5), (0.6, 1.35, 1.05), (0.6, 0.95, 1.45))  # each of mean 1
POWER = 0.4  # radiance times radius^2
DOWN_DEG = (14.5, 19.0, 23.5, 28.0)  # of the line from the eye to the middle of a plate
DISTANCE = (15.4, 14.6, 13.8, 13.0)  # along it


def unit(v):
    """Return a vector, [3], of length 1."""
    return v / np.linalg.norm(v)


def plate(down_deg, distance):
    """Return the centre and the normal of a plate, each [3], in the plane x = 0.

    The normal bisects the directions to the eye and to the row of lights at y = z = 0.
    """
    down = np.radians(down_deg)
    centre = EYE + distance * np.array([0.0, -np.sin(down), -np.cos(down)])
    return centre, unit(unit(EYE - centre) + unit(-centre))


def plates():
    """Return the XML of the plates."""
    return "".join(
        f"""\
    <shape type="rectangle" id="plate_{i}">
        <transform name="to_world">
            <scale x="4" y="0.5"/>
            <rotate x="1" angle="{-np.degrees(np.arctan2(normal[1], normal[2])):.5f}"/>
            <translate y="{centre[1]:.5f}" z="{centre[2]:.5f}"/>
        </transform>
        <bsdf type="roughconductor" id="metal_{i}">
            <string name="material" value="none"/>
            <string name="distribution" value="ggx"/>
            <float name="alpha" value="$alpha_{i}"/>
            <rgb name="specular_reflectance" value="0.8, 0.8, 0.8"/>
        </bsdf>
    </shape>

"""
        for i, (centre, normal) in enumerate(map(plate, DOWN_DEG, DISTANCE), 1)
    )


def lights():
    """Return the XML of the lights: radiance over radius^2 is the same but for the tint."""
    return "".join(
        f"""\
    <shape type="sphere" id="light_{i}">
        <point name="center" x="{x}" y="0" z="0"/>
        <float name="radius" value="{radius}"/>
        <ref id="black" name="bsdf"/>
        <emitter type="area" id="emitter_{i}">
            <rgb name="radiance" value="{", ".join(f"{POWER * t / radius**2:.6g}" for t in tint)}"/>
        </emitter>
    </shape>

"""
        for i, (x, radius, tint) in enumerate(zip(LIGHTS_X, RADII, TINTS, strict=True), 1)
    )


def derived(text):
    """Return the text of the scene with the derived numbers in it."""
    before, rest = text.split(BEGIN)
    return before + BEGIN + plates() + lights() + END + rest.split(END)[1]


def main():
    text = SCENE.read_text(encoding="utf-8")
    new = derived(text)
    if "--check" in sys.argv[1:]:
        sys.exit(0 if new == text else f"{SCENE}: its numbers are not the derived ones")
    SCENE.write_text(new, encoding="utf-8")


if __name__ == "__main__":
    main()
