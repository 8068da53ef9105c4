"""Render scenes whose XML is mutated at random: each ends in a picture of finite pixels, or in one line and exit 2.

Each mutant is rendered by the command line in a process of its own, so that an abort or an endless loop is seen. The
processes are forked from this one, which has imported everything and run nothing. ::

    python tests/fuzz.py                            2000 mutants of seeds from a random one on
    python tests/fuzz.py --first 0 --count 200      those of the seeds 0 to 199
    python tests/fuzz.py --seed 17 --keep FOLDER    one of them, whose scene, picture and messages stay in FOLDER
"""

import argparse
import collections
import os
import random
import re
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

SIZE = 12  # pixels of a picture's side
LIMIT = 20  # seconds for one mutant
SLOW_LIMIT = 120  # for one whose effects are chosen: it compiles a dozen of kernels
MEMORY = 8 << 30  # bytes of addresses for one mutant
SHARE = 1 / 3  # of the mutants end in a picture at least, or the mutations are too rough to show much
PICTURE, ERROR = "picture", "error"
NOT_FINITE = 99  # exit code of a process whose picture has pixels that aren't finite

NUMBERS = (
    *(
        "0",
        "-0",
        "1e-42",
        "-1e-42",
        "1e-20",
        "1e-3",
        "0.5",
        "1",
        "2",
        "-1",
        "-7",
        "1000",
        "1e17",
        "1e30",
        "-1e30",
    ),
    *("2147483647", "-2147483648", "99999999999999999999", "nan", "inf"),
)
NUMERIC = ("value", "x", "y", "z", "angle", "origin", "target", "up")
TYPES = {
    "bsdf": "diffuse dielectric thindielectric roughdielectric conductor roughconductor plastic roughplastic phong"
    " pplastic principled principledthin hair null mask twosided blendbsdf bumpmap normalmap",
    "shape": "sphere cylinder disk rectangle cube",
    "emitter": "point spot directional directionalarea area constant projector sunsky envmap",
    "texture": "checkerboard bitmap volume mesh_attribute",
    "rfilter": "box tent gaussian mitchell catmullrom lanczos",
    "sampler": "independent stratified multijitter orthogonal ldsampler owen_sobol zsobol",
    "sensor": "perspective thinlens orthographic radiancemeter irradiancemeter distant",
    "film": "hdrfilm specfilm",
    "integrator": "whitted distribution path direct",
}
TYPES = {kind: names.split() for kind, names in TYPES.items()}

FRAME = """<scene version="3.0.0">
    <default name="width" value="12"/>
    <default name="height" value="12"/>
    <default name="spp" value="1"/>
    <default name="integrator" value="distribution"/>
    <integrator type="$integrator"><integer name="max_depth" value="4"/></integrator>
    <sensor type="{sensor}" id="camera">
        <float name="near_clip" value="0.01"/>
        <float name="far_clip" value="100"/>
        {lens}
        <transform name="to_world"><lookat origin="0.3, 1.8, 4.5" target="0, 0.6, 0" up="0, 1, 0"/></transform>
        <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
        <film type="hdrfilm">
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
            <string name="pixel_format" value="rgb"/>
            <rfilter type="{rfilter}">{shape}</rfilter>
        </film>
    </sensor>
    <shape type="rectangle" id="floor">
        <transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/></transform>
        <bsdf type="diffuse" id="grey"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf>
    </shape>
    {body}
</scene>"""
FILTERS = {
    "box": "",
    "tent": '<float name="radius" value="1"/>',
    "gaussian": '<float name="stddev" value="0.5"/>',
    "mitchell": '<float name="B" value="0.33"/><float name="C" value="0.33"/>',
    "catmullrom": "",
    "lanczos": '<integer name="lobes" value="3"/>',
}
PINHOLE = '<float name="fov" value="45"/>'
LENS = PINHOLE + '<float name="aperture_radius" value="0.1"/><float name="focus_distance" value="4.5"/>'
LAMP = (
    '<shape type="rectangle" id="lamp"><transform name="to_world"><rotate x="1" angle="90"/>'
    '<scale x="0.7" z="0.4"/><translate x="0.5" y="2.5" z="1"/></transform>'
    '<emitter type="area"><rgb name="radiance" value="9, 8, 7"/></emitter></shape>'
)
CHECKS = (
    '<texture type="checkerboard" name="{}"><rgb name="color0" value="0.1, 0.2, 0.3"/>'
    '<rgb name="color1" value="0.7, 0.6, 0.5"/><transform name="to_uv"><scale x="4" y="3"/></transform></texture>'
)
BITMAP = (
    '<texture type="bitmap" name="{}"><string name="filename" value="sky.ppm"/><boolean name="raw" value="true"/>'
    "</texture>"
)


def balls(*bsdfs):
    """Spheres side by side, with a BSDF each, under the lamp."""
    x = (2.4 * (number + 0.5) / len(bsdfs) - 1.2 for number in range(len(bsdfs)))
    return LAMP + "".join(
        f'<shape type="sphere"><point name="center" x="{place:.2f}" y="0.6" z="0"/>'
        f'<float name="radius" value="0.3"/>{bsdf}</shape>'
        for place, bsdf in zip(x, bsdfs, strict=True)
    )


def scenes():
    """Return the XML of the scenes that are mutated, by name: those of the package and some with what they lack."""
    from whitted.scene import shipped, shipped_path

    rough = '<string name="distribution" value="beckmann"/><float name="alpha" value="0.2"/>'
    plastic = '<bsdf type="plastic"><rgb name="diffuse_reflectance" value="0.5, 0.3, 0.1"/></bsdf>'
    own = {
        "transmitting": ("perspective", PINHOLE, "box", balls(
            '<bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>',
            f'<bsdf type="roughdielectric">{rough}<float name="int_ior" value="1.3"/></bsdf>',
            '<bsdf type="thindielectric"><string name="int_ior" value="bk7"/></bsdf>',
            '<bsdf type="null"/>',
        )),
        "reflecting": ("thinlens", LENS, "gaussian", balls(
            '<bsdf type="conductor"><string name="material" value="Au"/></bsdf>',
            f'<bsdf type="roughconductor">{rough}<rgb name="eta" value="0.2"/><rgb name="k" value="4"/></bsdf>',
            f'<bsdf type="roughplastic">{rough}<boolean name="nonlinear" value="true"/></bsdf>',
            '<bsdf type="phong"><rgb name="diffuse_reflectance" value="0.6, 0.1, 0.1"/>'
            '<float name="specular_reflectance" value="0.3"/><float name="shininess" value="100"/></bsdf>',
        )),
        "layered": ("perspective", PINHOLE, "tent", balls(
            '<bsdf type="principled"><rgb name="base_color" value="0.8, 0.2, 0.1"/><float name="metallic" value="0.3"/>'
            '<float name="roughness" value="0.4"/><float name="spec_trans" value="0.2"/></bsdf>',
            '<bsdf type="principledthin"><float name="roughness" value="0.3"/><float name="diff_trans" value="0.7"/>'
            '<float name="eta" value="1.4"/></bsdf>',
            plastic,
            '<bsdf type="hair"><float name="eumelanin" value="0.3"/></bsdf>',
        )),
        "nested": ("perspective", PINHOLE, "mitchell", balls(
            f'<bsdf type="mask"><float name="opacity" value="0.4"/>{plastic}</bsdf>',
            f'<bsdf type="twosided">{plastic}<bsdf type="diffuse"/></bsdf>',
            '<bsdf type="blendbsdf"><float name="weight" value="0.3"/><bsdf type="diffuse"/>'
            '<bsdf type="twosided"><bsdf type="conductor"/></bsdf></bsdf>',
            f'<bsdf type="mask">{CHECKS.format("opacity")}<bsdf type="twosided"><bsdf type="phong"/></bsdf></bsdf>',
        )),
        "bumpy": ("perspective", PINHOLE, "catmullrom", balls(
            f'<bsdf type="bumpmap">{BITMAP.format("arbitrary")}<float name="scale" value="0.1"/>'
            f'<bsdf type="roughconductor">{rough}</bsdf></bsdf>',
            f'<bsdf type="normalmap">{BITMAP.format("normalmap")}<bsdf type="diffuse"/></bsdf>',
            f'<bsdf type="diffuse">{CHECKS.format("reflectance")}</bsdf>',
            f'<bsdf type="diffuse">{BITMAP.format("reflectance")}</bsdf>',
        )),
        "lights": ("perspective", PINHOLE, "lanczos", balls('<ref id="grey"/>', plastic)
            + '<emitter type="point"><point name="position" x="1" y="2" z="1"/><rgb name="intensity" value="5"/>'
            '</emitter><emitter type="spot"><transform name="to_world"><lookat origin="0, 3, 1" target="0, 0, 0"'
            ' up="0, 0, 1"/></transform><rgb name="intensity" value="9"/><float name="cutoff_angle" value="30"/>'
            '<float name="beam_width" value="20"/></emitter><emitter type="directional"><vector name="direction"'
            ' x="0.2" y="-1" z="-0.3"/><rgb name="irradiance" value="0.5"/></emitter><emitter type="constant">'
            '<rgb name="radiance" value="0.1, 0.2, 0.3"/></emitter><shape type="sphere"><point name="center" x="-1"'
            ' y="2" z="0"/><float name="radius" value="0.1"/><emitter type="area"><rgb name="radiance" value="30"/>'
            '</emitter></shape><shape type="disk"><transform name="to_world"><rotate y="1" angle="90"/><scale'
            ' value="0.2"/><translate x="-2" y="1"/></transform><emitter type="area">' + CHECKS.format("radiance")
            + "</emitter></shape>"),
        "environment": ("perspective", PINHOLE, "box", balls('<ref id="grey"/>', '<bsdf type="dielectric"/>')
            + '<emitter type="envmap"><string name="filename" value="sky.ppm"/><float name="scale" value="2"/>'
            '<transform name="to_world"><rotate y="1" angle="30"/></transform></emitter><emitter type="projector">'
            + BITMAP.format("irradiance") + '<float name="fov" value="40"/><transform name="to_world"><lookat'
            ' origin="0, 3, 2" target="0, 0, 0" up="0, 0, 1"/></transform></emitter>'),
        "daylight": ("orthographic", "", "gaussian", balls('<ref id="grey"/>', '<bsdf type="roughplastic"/>')
            + '<emitter type="sunsky"><float name="turbidity" value="3"/><float name="sun_scale" value="1"/>'
            '<vector name="sun_direction" x="0.3" y="0.5" z="0.8"/></emitter>'),
        "shapes": ("thinlens", LENS, "gaussian", LAMP
            + '<shape type="cylinder"><point name="p0" x="-1" y="0" z="0"/><point name="p1" x="-1" y="1" z="0.2"/>'
            '<float name="radius" value="0.2"/><ref id="grey"/></shape><shape type="disk"><transform name="to_world">'
            '<scale value="0.3"/><translate y="0.7"/></transform></shape><shape type="shapegroup" id="group">'
            '<shape type="sphere"><float name="radius" value="0.3"/><bsdf type="conductor"/></shape>'
            '<shape type="cube"><transform name="to_world"><scale value="0.1"/><translate y="0.4"/></transform></shape>'
            '</shape><shape type="instance"><ref id="group"/><transform name="to_world"><scale x="1" y="0.5" z="2"/>'
            '<rotate y="1" angle="30"/><translate x="0.6" y="0.5"/></transform></shape><shape type="instance">'
            '<ref id="group"/><transform name="to_world"><translate x="1.2" y="0.3" z="-1"/></transform></shape>'
            '<shape type="ply"><string name="filename" value="mesh.ply"/><ref id="grey"/></shape>'
            '<shape type="obj"><string name="filename" value="mesh.obj"/><boolean name="face_normals" value="true"/>'
            '<transform name="to_world"><translate x="-0.5" z="0.5"/></transform>'
            '<emitter type="area"><rgb name="radiance" value="2"/></emitter></shape>'),
    }  # fmt: skip
    texts = {name: shipped_path(name).read_text(encoding="utf-8") for name in shipped()}
    for name, (sensor, lens, rfilter, body) in own.items():
        texts[name] = FRAME.format(
            sensor=sensor, lens=lens, rfilter=rfilter, shape=FILTERS[rfilter], body=body
        )
    return texts


def write_files(folder):
    """Write the files to which the scenes refer."""
    corners = ((0, 0, 0), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 0.5))
    faces = ((0, 1, 2), (0, 1, 3), (0, 2, 3))
    lines = ["ply", "format ascii 1.0", f"element vertex {len(corners)}"]
    lines += [f"property float {axis}" for axis in "xyz"] + [f"element face {len(faces)}"]
    lines += ["property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(str, corner)) for corner in corners]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces]
    (folder / "mesh.ply").write_text("\n".join(lines) + "\n")
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (folder / "mesh.obj").write_text("\n".join(lines) + "\n")
    (folder / "sky.ppm").write_bytes(b"P6\n8 4\n255\n" + bytes(range(60, 156)))


@dataclass
class Mutant:
    """A mutated scene: what it was, how it is rendered, and what was done to it."""

    seed: int
    scene: str
    text: str
    spp: int
    is_slow: bool
    changes: list = field(default_factory=list)


def mutant(seed, texts):
    """Return the ``Mutant`` of a seed; ``texts`` are the ``scenes()``."""
    dice = random.Random(seed)
    name = dice.choice(sorted(texts))
    root = ET.fromstring(re.sub(r"<!--.*?-->", "", texts[name], flags=re.DOTALL))
    set_integrator(dice, root)
    changes = []
    while not changes or dice.random() < 0.2:
        (change,) = dice.choices(list(MUTATIONS), MUTATIONS.values())
        if made := change(dice, root):
            changes.append(made)
    text = ET.tostring(root, encoding="unicode")
    return Mutant(seed, name, text, dice.choice((1, 1, 2)), chooses_effects(root), changes)


def set_integrator(dice, root):
    """Choose the integrator; one in ten times `distribution` may choose its effects."""
    name = dice.choice(("whitted", "distribution"))
    for element in root.iterfind("default"):
        if element.get("name") == "integrator":
            element.set("value", name)
    parameters = {
        "distribution": ("integer", "rr_depth", "5"),
        "whitted": ("float", "min_contribution", "0.001"),
    }
    tag, parameter, value = parameters[name]
    ET.SubElement(root.find("integrator"), tag, name=parameter, value=value)
    if name == "distribution" and dice.random() < 0.9:
        ET.SubElement(root.find("integrator"), "string", name="effects", value="all")


def chooses_effects(root):
    """Whether `distribution` may choose its effects, for which many kernels are compiled."""
    element = root.find("integrator")
    if element is None:
        return True
    default = root.find("default[@name='integrator']")
    name = element.get("type", "").replace("$integrator", "" if default is None else default.get("value", ""))
    return name != "whitted" and all(part.get("name") != "effects" for part in element)


def change_number(dice, root):
    """One number becomes one of ``NUMBERS``; numbers in lists and matrices, of which there are most, half as often."""
    elements = list(root.iter())
    if dice.random() < 0.5:
        elements = [element for element in elements if element.tag in ("float", "integer", "default")]
    places = [
        (element, name, match)
        for element in elements
        for name in NUMERIC
        if name in element.attrib and element.tag != "string"
        for match in re.finditer(r"[-+\d.][-+\d.eE]*", element.attrib[name])
        if re.search(r"\d", match[0])
    ]
    if not places:
        return None
    element, name, match = dice.choice(places)
    old, number = element.get(name), dice.choice(NUMBERS)
    element.set(name, old[: match.start()] + number + old[match.end() :])
    return f"{label(element)}: {name}={old!r} became {element.get(name)!r}"


def drop_node(dice, root):
    parent, node = pick(dice, root)
    parent.remove(node)
    return f"{label(node)} of {label(parent)} dropped"


def double_node(dice, root):
    parent, node = pick(dice, root)
    copy = ET.fromstring(ET.tostring(node))
    if dice.random() < 0.7:
        for element in copy.iter():
            if element.tag != "ref":
                element.attrib.pop("id", None)
    parent.insert(list(parent).index(node), copy)
    return f"{label(node)} of {label(parent)} doubled"


def nest_node(dice, root):
    parent, node = pick(dice, root)
    inside = set(node.iter())
    goals = [element for element in root.iter() if element not in inside and element is not parent]
    if not goals:
        return None
    goal = dice.choice(goals)
    parent.remove(node)
    goal.append(node)
    return f"{label(node)} of {label(parent)} put into {label(goal)}"


def drop_attribute(dice, root):
    element = dice.choice([element for element in root.iter() if element.attrib])
    name = dice.choice(sorted(element.attrib))
    value = element.attrib.pop(name)
    return f"{element.tag} lost {name}={value!r}"


def swap_attributes(dice, root):
    """Two elements swap the values of an attribute, mostly elements of one kind."""
    one = dice.choice([element for element in root.iter() if element.attrib])
    name = dice.choice(sorted(one.attrib))
    alike = dice.random() < 0.8
    others = [e for e in root.iter() if e is not one and name in e.attrib and (e.tag == one.tag or not alike)]
    if not others:
        return None
    other = dice.choice(others)
    was = label(one), label(other)
    one.attrib[name], other.attrib[name] = other.attrib[name], one.attrib[name]
    return f"{was[0]} and {was[1]} swapped {name}"


def break_reference(dice, root):
    places = [
        (e, name) for e in root.iter() for name in ("id", "value") if name == "id" or "$" in e.get(name, "")
    ]
    places = [(e, name) for e, name in places if e.tag == "ref" or name == "value"]
    if not places:
        return None
    element, name = dice.choice(places)
    ids = sorted(e.get("id") for e in root.iter() if e.get("id") and e.tag != "ref")
    value = "none" if dice.random() < 0.5 or not ids else dice.choice(ids)
    element.set(name, value if name == "id" else f"${value}")
    return f"{element.tag} refers to {value!r}"


def change_type(dice, root):
    elements = [element for element in root.iter() if element.tag in TYPES and element.get("type")]
    if not elements:
        return None
    element = dice.choice(elements)
    old = element.get("type")
    element.set("type", dice.choice(TYPES[element.tag]))
    return f"{element.tag} of type {old!r} became {element.get('type')!r}"


MUTATIONS = {
    change_number: 70,
    drop_node: 8,
    double_node: 6,
    nest_node: 4,
    drop_attribute: 3,
    swap_attributes: 5,
    break_reference: 2,
    change_type: 4,
}


def pick(dice, root):
    """A random element with its parent."""
    return dice.choice([(parent, node) for parent in root.iter() for node in parent])


def label(element):
    names = " ".join(
        f"{name}={element.get(name)!r}" for name in ("type", "name", "id") if name in element.attrib
    )
    return f"<{element.tag}{' ' * bool(names)}{names}>"


@dataclass
class Ending:
    """How a mutant ended: ``kind`` is ``picture``, ``error``, or what is wrong; ``message`` the last line said."""

    kind: str
    seconds: float
    message: str

    @property
    def is_good(self):
        return self.kind in (PICTURE, ERROR)


class Nursery:
    """Renders mutants in processes that are forked from this one, in a folder.

    This process runs no kernel, since Dr.Jit's workers don't survive a fork. One thread of its Python module sleeps
    from the import on, until another thread leaves it something to free, and isn't missed.
    """

    def __init__(self, folder):
        self.folder = folder
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        import whitted  # noqa: I001, first, as it finds LLVM
        import drjit as dr
        import mitsuba as mi
        import OpenEXR  # noqa: F401
        import whitted.cli.render
        import whitted.passes  # noqa: F401

        dr.set_thread_count(1)
        mi.set_variant("llvm_ad_rgb")
        threads = len(os.listdir("/proc/self/task"))
        if threads > 2:
            raise RuntimeError(f"there are {threads} threads, and a fork keeps one")
        warnings.filterwarnings("ignore", ".*multi-threaded", DeprecationWarning)  # from Python 3.12 on
        write_files(folder)

    def render(self, one):
        """Render a ``Mutant``; return its ``Ending``."""
        scene, out, err, picture = (
            self.folder / name for name in ("mutant.xml", "out.txt", "err.txt", "mutant.exr")
        )
        picture.unlink(missing_ok=True)
        scene.write_text(one.text, encoding="utf-8")
        size = f"--width {SIZE} --height {SIZE} --spp {one.spp}".split()
        limit = SLOW_LIMIT if one.is_slow else LIMIT
        begin = time.perf_counter()
        child = os.fork()
        if child == 0:
            run_child(["render", str(scene), "-o", str(picture), *size], out, err, picture)
        status = wait(child, limit)
        seconds = time.perf_counter() - begin
        if status is None:
            return Ending("hang", seconds, f"not done after {limit} s")
        text = err.read_text(errors="replace")
        return Ending(
            judge(os.waitstatus_to_exitcode(status), text), seconds, "".join(text.splitlines()[-1:])
        )


def run_child(arguments, out, err, picture):
    """Run the command line in this forked process, and end it."""
    code = 70
    try:
        for number, path in ((1, out), (2, err)):
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
            os.dup2(descriptor, number)
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        from whitted import cli

        try:
            cli.main(arguments)
        except SystemExit as done:
            code = done.code
        if code in (0, 4) and not is_finite(picture):
            code = NOT_FINITE
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def is_finite(picture):
    """Whether all colours of an EXR file are finite."""
    import numpy as np
    import OpenEXR

    with OpenEXR.File(str(picture)) as file:
        channels = file.channels()
        names = [name for name in channels if name in ("RGB", "RGBA", "R", "G", "B", "Y")]
        return bool(names) and all(np.isfinite(channels[name].pixels).all() for name in names)


def wait(child, limit):
    """Return the wait status of a child process, or None where it had to be killed after ``limit`` seconds."""
    descriptor = os.pidfd_open(child)
    try:
        done, _, _ = select.select([descriptor], [], [], limit)
        if not done:
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    finally:
        os.close(descriptor)
    return status if done else None


def judge(code, text):
    """Return the kind of ending of a process: ``code`` is its exit code or minus a signal, ``text`` its messages."""
    if code < 0:
        return f"abort ({signal.Signals(-code).name})"
    if code == NOT_FINITE:
        return "picture that isn't finite"
    if code not in (0, 2, 4):
        return f"exit {code}"
    lines = text.splitlines()
    errors = sum(line.startswith("whitted: error: ") for line in lines)
    if errors != (code == 2) or not all(line.startswith("whitted: ") for line in lines):
        return "not one line"
    if re.search(r"Traceback|\.(cpp|h|py):\d", text):
        return "a place in the code"
    return ERROR if code == 2 else PICTURE


def run(seeds, count, folder, keep=None, quick=False):
    """Render ``count`` mutants of some seeds, and tell of those that end badly; return whether all is well.

    ``quick`` leaves out mutants that compile many kernels; ``keep`` is the folder where failing ones stay.
    """
    nursery, texts, kinds = Nursery(folder), scenes(), collections.Counter()
    for seed in seeds:
        one = mutant(seed, texts)
        if quick and one.is_slow:
            continue
        ending = nursery.render(one)
        kinds[ending.kind] += 1
        if count == 1 or not ending.is_good:
            print(f"seed {seed}, {one.scene}: {ending.kind}, {ending.seconds:.2f} s: {ending.message}")
            print(*(f"    {change}\n" for change in one.changes), sep="", end="", flush=True)
            if keep is not None:
                shutil.copytree(folder, keep if count == 1 else keep / str(seed), dirs_exist_ok=True)
        if kinds.total() == count:
            break
    print(f"seeds {seeds[0]} to {seed}:", ", ".join(f"{n} {kind}" for kind, n in kinds.most_common()))
    return kinds[PICTURE] + kinds[ERROR] == count and (count < 100 or kinds[PICTURE] >= SHARE * count)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=2000, help="how many mutants")
    parser.add_argument("--first", type=int, help="the first one's seed, by default a random one")
    parser.add_argument("--seed", type=int, help="this mutant alone")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where failing mutants stay")
    parser.add_argument("--quick", action="store_true", help="leave out mutants that compile many kernels")
    arguments = parser.parse_args()
    first, count = arguments.first, arguments.count
    if arguments.seed is not None:
        first, count = arguments.seed, 1
    elif first is None:
        first = random.randrange(1 << 31)
    seeds = range(first, first + 10 * count)
    with tempfile.TemporaryDirectory() as folder:
        sys.exit(not run(seeds, count, Path(folder), arguments.keep, arguments.quick))


if __name__ == "__main__":
    main()
