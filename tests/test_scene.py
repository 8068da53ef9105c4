"""Scenes load as Mitsuba loads them, and every mistake in one is told in one line: file, line and value."""

import shutil

import pytest

import whitted
from whitted import messages, scene, specification
from whitted.errors import UsageError

SENSOR = """<sensor type="perspective" id="camera">
<film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/></film>
</sensor>"""


@pytest.fixture
def write(tmp_path):
    """Write a scene with a sensor on lines 2 to 4, so that the body starts on line 5; return its path."""

    def write(body, name="scene.xml", sensor=SENSOR):
        path = tmp_path / name
        path.write_text(f'<scene version="3.0.0">\n{sensor}\n{body}\n</scene>\n')
        return path

    return write


def refusal(path, **defines):
    with pytest.raises(UsageError) as caught:
        scene.load(path, **defines)
    line = str(caught.value)
    assert "\n" not in line
    assert ".cpp" not in line
    assert "Traceback" not in line
    return line


BODIES = {
    "<shape": ":6: malformed XML: ",
    '<shape type="sphre"/>': ":5: no shape is called 'sphre'; did you mean 'sphere'",
    '<bsdf type="sphere"/>': ":5: 'sphere' is a shape, not a bsdf",
    '<integrator type="whited"/>': ":5: no integrator is called 'whited'; did you mean 'whitted'",
    '<shape type="sphere">\n<float name="raduis" value="1"/></shape>': (
        ":6: 'sphere' has no property 'raduis'; did you mean 'radius'"
    ),
    '<integrator type="path"><integer name="maxDepth" value="1"/></integrator>': "did you mean 'max_depth'",
    '<integrator type="whitted"><integer name="max_deph" value="1"/></integrator>': "did you mean 'max_depth'",
    '<shape type="sphere"><float name="q_q" value="1"/></shape>': "'sphere' has no property 'q_q'",
    '<bsdf type="diffuse"><texture type="checkerboard" name="reflectanc"/></bsdf>': "did you mean 'reflectance'",
    '<shape type="sphere"><animation name="to_world"/></shape>': ":5: encountered an unsupported XML element: <anim",
    '<shape type="ply"><string name="filename" value="no.ply"/></shape>': ":5: the file 'no.ply' of 'ply' does not",
    '<bsdf type="diffuse"><texture type="bitmap" name="reflectance">\n<string name="filename" value="no.png"/>'
    "</texture></bsdf>": ":5: the file 'no.png' of 'bitmap' does not exist",
    '<include filename="no.xml"/>': ':5: included file "no.xml" not found',
    '<shape type="sphere"><float name="radius" value="$r"/></shape>': ":5: undefined parameter: $r",
    '<shape type="sphere"><float name="radius" value="abc"/></shape>': ':5: could not parse floating point value "abc',
    '<shape type="sphere"><string name="radius" value="1"/></shape>': "expected float, got string",
    '<shape type="sphere"><ref id="none"/></shape>': ":5: unresolved reference",
    '<shape type="sphere" id="camera"/>': ":5: duplicate ID",
    '<shape type="sphere">\n<float name="radius" value="1"/><float name="radius" value="2"/></shape>': (
        ":6: <float name='radius'> stands beside another 'radius'"
    ),
    '<bsdf type="null" id="a"/><shape type="cube"><ref id="a" name="bsdf"/>\n<ref id="a" name="bsdf"/></shape>': (
        ":6: <ref name='bsdf'> stands beside another 'bsdf'"
    ),
    '<shape type="cube" name="a"/>\n<shape type="sphere" name="a"/>': ":6: <shape name='a'> stands beside another 'a'",
    # the plugin reads it, but not beside what else is there
    '<sensor type="perspective"><string name="focal_length" value="50mm"/>\n<string name="fov_axis" value="x"/>'
    "</sensor>": ":6: 'perspective' does not use its property 'fov_axis' here",
}


@pytest.mark.parametrize(("body", "expected"), BODIES.items(), ids=range(len(BODIES)))
def test_mistakes_are_told_in_one_line(write, body, expected):
    path = write(body)
    line = refusal(path)
    assert line.startswith(f"{path}:")
    assert expected in line


NUMBERS = {
    '<shape type="sphere">\n<float name="radius" value="nan"/></shape>': ":6: <float name='radius'> has value=nan",
    '<shape type="sphere"><point name="center" x="0" y="-inf" z="0"/></shape>': "y=-inf",
    '<shape type="sphere"><point name="center" value="0, NaN, 0"/></shape>': "value=NaN",
    '<shape type="sphere"><float name="radius" value="1e39"/></shape>': "value=1e39",
    '<bsdf type="diffuse"><rgb name="reflectance" value="0.5 inf 0"/></bsdf>': "value=inf",
    '<emitter type="point">\n\n<spectrum name="intensity" value="400:1, 700:nan"/></emitter>': ":7: ",
    '<emitter type="constant"><spectrum name="radiance" value="infinity"/></emitter>': "value=infinity",
    '<shape type="cube"><transform name="to_world">\n<scale value="nan"/></transform></shape>': ":6: <scale> has",
    '<shape type="cube"><transform name="to_world"><rotate x="1" angle="inf"/></transform></shape>': "angle=inf",
    '<shape type="cube"><transform name="to_world"><matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 nan 1"/></transform>'
    "</shape>": "<matrix> has value=nan",
    '<shape type="cube"><transform name="to_world"><lookat origin="0,0,nan" target="0,0,0" up="0,1,0"/></transform>'
    "</shape>": "origin=nan",
    '<default name="r" value="nan"/><shape type="sphere"><float name="radius" value="$r"/></shape>': "value=nan",
    '<!-- a -- b\n --><shape type="sphere"><float name="radius" value="nan"/></shape>': ":6: ",
    # no single number is wrong here: only the parsed matrix shows it
    '<shape type="cube"><transform name="to_world"><scale value="1e38"/><scale value="9e37"/></transform></shape>': (
        ":5: 'to_world' of 'cube' contains "
    ),
}


@pytest.mark.parametrize(("body", "expected"), NUMBERS.items(), ids=range(len(NUMBERS)))
def test_numbers_that_are_not_finite_are_refused(write, body, expected):
    path = write(body)
    line = refusal(path)
    assert line.startswith(f"{path}:")
    assert expected in line
    assert "finite" in line


# What would abort Mitsuba, never end, or be rendered as something else.
PARTS = {
    '<bsdf type="diffuse"><texture type="bitmap" name="reflectance"/></bsdf>': "'bitmap' needs a 'filename'",
    '<bsdf type="blendbsdf"/>': "'blendbsdf' needs two BSDFs, not 0",
    '<bsdf type="blendbsdf"><float name="weight" value="1"/><bsdf type="diffuse"/></bsdf>': "two BSDFs, not 1",
    '<bsdf type="diffuse"><texture type="volume" name="reflectance"/></bsdf>': "'volume' needs a <volume>",
    '<sensor type="irradiancemeter"/>': "'irradiancemeter' measures on a shape",
    '<shape type="shapegroup"/>': "'shapegroup' needs a shape",
    '<emitter type="timed_sunsky"/>': "'timed_sunsky' cannot be rendered",
    '<emitter type="area"/>': "'area' shines from a shape",
    '<shape type="sphere"><emitter type="point"/></shape>': "'point' does not shine from a shape",
    '<emitter type="point"><rgb name="intensity" value="1, -2, 1"/></emitter>': "'point' emits -2; accepted are",
    '<emitter type="sunsky"><float name="sun_scale" value="-1"/></emitter>': "'sunsky' emits -1; accepted are",
    '<shape type="sphere"><emitter type="area"><texture type="checkerboard" name="radiance"><spectrum type="d65"'
    ' name="color0"><rgb name="color" value="1 1 -3"/></spectrum></texture></emitter></shape>': "'area' emits -3",
    '<shape type="cylinder"><point name="p1" x="0" y="0" z="-0"/></shape>': "a 'p0' and a 'p1' that differ",
    '<shape type="cylinder"><point name="p0" x="0" y="1e30" z="0"/></shape>': "'p0' of 'cylinder' contains 1e+30",
    '<shape type="cube"><transform name="to_world"><scale value="1e30"/></transform></shape>': "a length up to 1e18",
    '<shape type="disk"><transform name="to_world"><scale z="0"/></transform></shape>': "'to_world' of 'disk' flattens",
    '<shape type="cube"><transform name="to_world"><scale value="1e-30"/></transform></shape>': "scales from 1e-18 on",
    '<sensor type="perspective"><sampler type="multijitter"><integer name="sample_count" value="0"/></sampler>'
    "</sensor>": "'sample_count' of 'multijitter' is 0; accepted are 1 to 1073741824",
    '<sensor type="perspective"><sampler type="ldsampler"><integer name="sample_count" value="2147483647"/></sampler>'
    "</sensor>": "'sample_count' of 'ldsampler' is 2147483647; accepted are 1 to",
    '<sensor type="perspective"><film type="hdrfilm"><integer name="crop_offset_x" value="4294967295"/></film>'
    "</sensor>": "'crop_offset_x' of 'hdrfilm' is 4294967295; accepted are 0 to 65534",
    '<sensor type="perspective"><film type="hdrfilm"><rfilter type="tent"><float name="radius" value="-1"/></rfilter>'
    "</film></sensor>": "'radius' of 'tent' is -1; accepted are 0 to 64",
}


@pytest.mark.parametrize(("body", "expected"), PARTS.items(), ids=range(len(PARTS)))
def test_what_mitsuba_does_not_notice_is_refused(write, body, expected):
    path = write(body)
    line = refusal(path)
    assert line.startswith(f"{path}:5: ")
    assert expected in line


def test_what_is_used_elsewhere_has_its_parts(write):
    body = (
        '<emitter type="area" id="glow"/><shape type="sphere"><ref id="glow"/></shape>'
        '<shape type="sphere"><sensor type="irradiancemeter"><film type="hdrfilm"><rfilter type="box"/></film></sensor>'
        '</shape><shape type="cylinder"><point name="p0" x="0" y="0" z="2"/></shape>'
        '<bsdf type="blendbsdf"><float name="weight" value="0.5"/><bsdf type="diffuse"/><bsdf type="phong"/></bsdf>'
        '<shape type="cube" name="a"/><shape type="cube" name="b"/>'
    )
    assert len(scene.load(write(body)).mitsuba.shapes()) == 5


def test_numbers_are_checked_in_parameters_and_includes(write):
    write('<shape type="sphere"><float name="radius" value="$r"/></shape>', name="ball.xml", sensor="")
    path = write('<default name="r" value="1"/>\n<include filename="ball.xml"/>')
    scene.load(path)
    assert "ball.xml:3: <float name='radius'> has value=nan" in refusal(path, r=float("nan"))


def test_files_that_are_no_scenes(tmp_path, write):
    assert refusal(tmp_path / "none.xml").endswith("none.xml: no such file")
    assert "a folder" in refusal(tmp_path)
    (tmp_path / "empty.xml").write_text("\n")
    assert "is empty" in refusal(tmp_path / "empty.xml")
    (tmp_path / "bsdf.xml").write_text('<!-- <scene/> -->\n<bsdf version="3.0.0" type="diffuse"/>')
    assert ":2: the root element is <bsdf>" in refusal(tmp_path / "bsdf.xml")
    (tmp_path / "latin.xml").write_bytes(b'<scene version="3.0.0">\n<!-- caf\xe9 --></scene>')
    assert ":2: the byte 0xe9 is no utf-8 text" in refusal(tmp_path / "latin.xml")
    assert "missing version attribute" in refusal(_written(tmp_path / "old.xml", "<scene/>"))
    assert "no <sensor>" in refusal(write("", sensor=""))


def _written(path, text):
    path.write_text(text)
    return path


def test_unknown_names_come_with_the_nearest():
    shipped = next(iter(scene.shipped()))
    assert f"did you mean '{shipped}'" in refusal(shipped + "x")
    assert "-D widht: the scene has no parameter of that name; did you mean 'width'" in refusal(
        shipped, widht=3
    )


def test_a_constructor_of_ours_is_quoted_without_traceback(write):
    import mitsuba as mi

    class Picky(mi.SamplingIntegrator):
        def __init__(self, props):
            super().__init__(props)
            raise ValueError("max_depth must be\nat least -1")

    mi.register_integrator("picky", Picky)
    assert refusal(write('<integrator type="picky"/>')).endswith(
        ":5: integrator 'picky': max_depth must be at least -1"
    )


def test_scenes_are_those_of_mitsuba(write, tmp_path):
    """Names, order, parameters, includes, folders of the search path, and files relative to the scene."""
    import mitsuba as mi

    (tmp_path / "parts").mkdir()
    mi.load_dict({"type": "rectangle"}).write_ply(str(tmp_path / "parts/wall.ply"))
    body = '<shape type="ply" id="wall"><string name="filename" value="parts/wall.ply"/></shape>'
    write(
        body + '<shape type="sphere"><float name="radius" value="$r"/></shape>',
        name="parts/part.xml",
        sensor="",
    )
    path = write(
        '<path value="parts"/><default name="r" value="2"/><include filename="part.xml"/>\n'
        '<shape type="ply" id="same"><string name="filename" value="wall.ply"/></shape>\n'
        '<bsdf type="diffuse" id="grey"/><shape type="cube" id="$name"><ref id="grey"/></shape>'
    )
    before = str(mi.file_resolver())
    ours = scene.load(path, name="box")
    assert str(mi.file_resolver()) == before
    theirs = mi.load_file(str(path), name="box", optimize=False)
    assert [shape.id() for shape in ours.mitsuba.shapes()] == [shape.id() for shape in theirs.shapes()]
    assert [str(shape.bbox()) for shape in ours.mitsuba.shapes()] == [
        str(shape.bbox()) for shape in theirs.shapes()
    ]
    assert ours.mitsuba.sensors()[0].id() == "camera"


def test_old_versions_are_upgraded(tmp_path):
    text = (
        '<scene version="0.6.0"><sensor type="perspective"/><shape type="sphere"><transform name="toWorld">'
    )
    path = _written(tmp_path / "old.xml", text + '<scale value="2"/></transform></shape></scene>')
    assert scene.load(path).mitsuba.shapes()[0].bbox().max[0] == 2


def test_the_hash_is_that_of_all_that_matters(write, tmp_path):
    import mitsuba as mi

    mi.load_dict({"type": "cube"}).write_ply(str(tmp_path / "mesh.ply"))
    body = (
        '<shape type="ply"><string name="filename" value="mesh.ply"/></shape><default name="id" value="a"/>'
    )
    path = write(body + '<shape type="cube" id="$id"/>')
    first = scene.load(path)
    assert (first.name, first.path) == ("scene", path)
    assert len(first.hash) == 64
    assert scene.load(path).hash == first.hash
    copy = tmp_path / "copy"
    copy.mkdir()
    shutil.copy(tmp_path / "mesh.ply", copy)
    assert scene.load(shutil.copy(path, copy)).hash == first.hash
    assert scene.load(path, id="b").hash != first.hash
    mi.load_dict({"type": "rectangle"}).write_ply(str(tmp_path / "mesh.ply"))
    assert scene.load(path).hash != first.hash


def test_scenes_are_accepted_in_every_form(write):
    import mitsuba as mi

    path = write('<shape type="sphere"/>')
    loaded = whitted.load(path)
    assert scene.as_scene(loaded) is loaded
    assert scene.as_scene(str(path)).hash == loaded.hash
    bare = mi.load_file(str(path), optimize=False)
    assert scene.as_scene(bare).mitsuba is bare
    for wrong in (3, None, bare.sensors()[0]):
        with pytest.raises(UsageError, match="is needed"):
            scene.as_scene(wrong)
    with pytest.raises(UsageError, match="no sensor"):
        scene.as_scene(mi.load_dict({"type": "scene"}))


def test_shipped_scenes_load_and_tell_what_they_are():
    for name, summary in scene.shipped().items():
        loaded = scene.load(name, width=4, height=2)
        assert loaded.mitsuba.sensors()[0].film().size()[0] == 4
        assert summary.endswith((".", ":"))
        assert "<" not in summary


def test_parameters_may_be_of_any_type(write):
    path = write(
        '<shape type="sphere"><float name="radius" value="$r"/><point name="center" value="$c"/>'
        '<boolean name="flip_normals" value="$f"/></shape>'
    )
    box = scene.load(path, r=2, c=(1, 2, 3.5), f=True).mitsuba.shapes()[0].bbox()
    assert list(box.max) == [3, 4, 5.5]


def test_integrators_as_users_write_them():
    import mitsuba as mi

    made, note = specification.integrator("path:max_depth=3.0,hide_emitters=true,rr_depth=7")
    assert note is None
    assert "max_depth = 3" in str(made)
    assert specification.integrator(made) == (made, None)
    assert "max_depth = 2" in str(specification.integrator({"type": "path", "max_depth": 2})[0])
    assert specification._parse("w:a=1e-3,b=false, c=0.1 0.2 .3,d=x,e=-4") == {
        "type": "w",
        "a": 1e-3,
        "b": False,
        "c": {"type": "rgb", "value": [0.1, 0.2, 0.3]},
        "d": "x",
        "e": -4,
    }
    assert (
        type(specification.integrator("whitted:max_depth=2")[0]).__module__ == "whitted.integrators.whitted"
    )
    assert isinstance(specification.integrator("prb")[0], mi.Integrator)


def test_a_missing_integrator_is_chosen_with_a_note(write):
    own = scene.load(write('<integrator type="whitted"/>')).mitsuba
    assert specification.integrator(None, own) == (own.integrator(), None)
    for body in ("", '<integrator type="path"/>'):
        made, note = specification.integrator(None, scene.load(write(body)).mitsuba)
        assert type(made).__module__.startswith("whitted.")
        assert "rendering with" in note


SPECIFICATIONS = {
    "whited": "did you mean 'whitted'",
    "sphere": "'sphere' is no integrator",
    "": "NAME[:key=value,...] is needed",
    "path:max_depth": "key=value is needed, not 'max_depth'",
    "path:max_depht=2": "did you mean 'max_depth'",
    "path:max_depth=2.5": "expected integer, got float",
    "path:hide_emitters=yes": "expected boolean, got string",
    "path:max_depth=nan": "contains nan",
    "whitted:ambeint=1": "did you mean 'ambient'",
}


@pytest.mark.parametrize(("spec", "expected"), SPECIFICATIONS.items())
def test_integrators_that_are_refused(spec, expected):
    with pytest.raises(UsageError) as caught:
        specification.integrator(spec)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)
    for wrong in ({}, 3, {"max_depth": 3}):
        with pytest.raises(UsageError):
            specification.integrator(wrong)


def test_plugin_names_are_of_their_kind():
    assert {"dielectric", "twosided"} <= set(messages.plugin_names("bsdf"))
    assert "path" not in messages.plugin_names("bsdf")
    assert {"whitted", "path", "prb"} <= set(messages.plugin_names("integrator"))
    assert {"gaussian"} <= set(messages.plugin_names("rfilter"))
