"""A line for each shape that Mitsuba turns inside out, and none for the others: what rays meet decides."""

import mitsuba as mi
import numpy as np
import pytest

import whitted

TETRAHEDRON = """v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""
SCENE = """<scene version="3.0.0">
    <sensor type="perspective"/>
    <emitter type="constant"/>
    <shape type="{plugin}">{file}
        <transform name="to_world"><scale x="{x}"/><rotate y="1" angle="30"/></transform>{more}
    </shape>
</scene>
"""
FLIPPED = '<boolean name="flip_normals" value="true"/>'
FACES = '<boolean name="face_normals" value="true"/>'
SHAPES = [  # plugin, file, further properties
    ("sphere", "", ""),
    ("sphere", "", FLIPPED),
    ("cube", "", ""),
    ("obj", "bare.obj", ""),
    ("obj", "bare.obj", FLIPPED),
    ("obj", "bare.obj", FACES),
    ("ply", "cube.ply", ""),
    ("ply", "cube.ply", FACES),
    ("ply", "cube.ply", FLIPPED),
]


@pytest.fixture
def load(tmp_path):
    (tmp_path / "bare.obj").write_text(TETRAHEDRON)
    mi.load_dict({"type": "cube"}).write_ply(str(tmp_path / "cube.ply"))

    def load(plugin, file, x, more):
        file = file and f'<string name="filename" value="{file}"/>'
        path = tmp_path / "scene.xml"
        path.write_text(SCENE.format(plugin=plugin, file=file, x=x, more=more))
        return whitted.load(path)

    return load


def points_inwards(scene):
    """Whether what a ray towards the shape's middle meets is shaded from within."""
    box = scene.bbox()
    middle, size = np.array(box.center()), np.array(box.extents()).max()
    origin = middle + size * np.array([1.0, 0.9, 0.8])
    towards = middle - origin
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(towards / np.linalg.norm(towards))))
    assert si.is_valid()[0]
    return mi.Frame3f.cos_theta(si.wi)[0] < 0


@pytest.mark.parametrize(("plugin", "file", "more"), SHAPES)
@pytest.mark.parametrize("x", [1, -1])
def test_what_is_turned_inside_out_is_said(load, plugin, file, more, x):
    scene = load(plugin, file, x, more)
    if more == FLIPPED:
        assert not scene.notes, "who wrote it knows"
    else:
        assert len(scene.notes) == points_inwards(scene.mitsuba)


def test_the_remedy_that_the_line_names_helps(load):
    assert points_inwards(load("sphere", "", 1, FLIPPED).mitsuba)
    assert not points_inwards(load("sphere", "", -1, FLIPPED).mitsuba)


def test_a_render_says_it_with_file_and_line(load):
    scene = load("sphere", "", -1, "")
    with pytest.warns(UserWarning, match=r"scene\.xml:4: 'to_world' mirrors this 'sphere'"):
        whitted.render(scene, "whitted", spp=1, crop=(0, 0, 2, 2))
