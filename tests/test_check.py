"""`check`: what it refuses to compare, what it must reject, and that it leaves the scene alone.

The statistical verdicts have fixed seeds; each assertion of agreement would fail for 1 % of the seeds (the
level), each of a rejection for fewer than 1 in 10^4 (the differences are above six standard errors).
"""

import json
from types import SimpleNamespace

import mitsuba as mi
import numpy as np
import pytest
from click.testing import CliRunner

from whitted.comparison import check
from whitted.errors import UsageError
from whitted.path_classes import compare_classes, estimate, has_null
from whitted.replicates import box_sensor, replicate, seeds, whole_grid

WHITTED = "E S* (L | D L)"


def cornell_box(size=64, **film):
    scene = mi.cornell_box()
    scene["sensor"]["film"].update(width=size, height=size, **film)
    return scene


def floor(*others, light=None):
    """A diffuse floor under a square lamp that reflects nothing, and further objects."""
    lamp = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 0, 3]).rotate([1, 0, 0], 180),
    }
    lamp |= {"emitter": {"type": "area", "radiance": 5.0}}
    lamp |= {"bsdf": {"type": "diffuse", "reflectance": 0.0}}
    to_world = mi.ScalarTransform4f().look_at([0, -6, 4], [0, 0, 0.5], [0, 0, 1])
    scene = {"type": "scene", "floor": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(3)}}
    scene["sensor"] = {"type": "perspective", "to_world": to_world}
    scene["sensor"]["film"] = {"type": "hdrfilm", "width": 32, "height": 32}
    scene["light"] = light or lamp
    scene |= {f"object{i}": other for i, other in enumerate(others)}
    return mi.load_dict(scene)


@pytest.fixture
def scaled():
    """Register an integrator that multiplies a nested one's radiance by ``weight``."""

    class Scaled(mi.SamplingIntegrator):
        def __init__(self, props):
            super().__init__(props)
            self.weight = props.get("weight", 1.0)
            self.nested = next(v for _, v in props.objects() if isinstance(v, mi.Integrator))

        def sample(self, scene, sampler, ray, medium=None, active=True):
            radiance, valid, aovs = self.nested.sample(scene, sampler, ray, medium, active)
            return radiance * self.weight, valid, aovs

        def to_string(self):
            return f"Scaled[{self.weight}]"

    mi.register_integrator("scaled_in_test", Scaled)
    return lambda weight: {
        "type": "scaled_in_test",
        "weight": weight,
        "nested": {"type": "path", "max_depth": 8},
    }


def compare(scene, max_depth=8, **reference):
    path = mi.load_dict({"type": "path", "max_depth": max_depth} | reference)
    tested = SimpleNamespace(estimates=WHITTED, max_depth=max_depth)
    return compare_classes(scene, scene.sensors()[0], tested, path, paths=1 << 15)


# Replicates


def test_replicates_are_what_a_box_filter_gives():
    film = {"crop_width": 20, "crop_height": 12, "crop_offset_x": 30, "crop_offset_y": 7}
    scene = mi.load_dict(cornell_box(**film))
    box = cornell_box(**film)
    box["sensor"]["film"]["rfilter"] = {"type": "box"}
    box["sensor"]["sampler"] = {"type": "multijitter"}
    box = mi.load_dict(box)
    path = mi.load_dict({"type": "path", "max_depth": 3})
    image = replicate(path, scene, box_sensor(scene.sensors()[0]), 5, 16)
    np.testing.assert_array_equal(image, np.array(path.render(box, box.sensors()[0], seed=5, spp=16)))


def test_lens_and_shutter_of_the_sensor_are_kept():
    scene = cornell_box(16)
    scene["sensor"] |= {"type": "thinlens", "aperture_radius": 0.2, "focus_distance": 3.0}
    scene["sensor"]["film"]["rfilter"] = {"type": "box"}
    scene["sensor"]["sampler"] = {"type": "multijitter"}
    scene = mi.load_dict(scene)
    path = mi.load_dict({"type": "path", "max_depth": 2})
    image = replicate(path, scene, box_sensor(scene.sensors()[0]), 1, 16)
    np.testing.assert_array_equal(image, np.array(path.render(scene, scene.sensors()[0], seed=1, spp=16)))


def test_seeds_are_apart_and_grids_are_full():
    used = [seed for side in range(4) for seed in seeds(side, 7, 100)]
    assert len(set(used)) == 400
    assert min(np.diff(np.sort(used))) == 100003
    assert [whole_grid(n) for n in (1, 2, 16, 17, 32)] == [1, 2, 16, 20, 35]


# Classes of paths


def test_cornell_box_is_comparable_at_depth_2_only():
    scene = mi.load_dict(cornell_box(16))
    assert compare(scene, 2).comparable
    found = compare(scene, 8)
    assert not found.comparable
    assert "E D D L" in found.reason


def test_shares_are_those_that_path_finds_bounce_by_bounce():
    scene = mi.load_dict(cornell_box(16))
    camera = box_sensor(scene.sensors()[0])
    mean = {
        d: replicate(mi.load_dict({"type": "path", "max_depth": d}), scene, camera, d, 400).mean()
        for d in (2, 3, 8)
    }
    assert compare(scene, 8).shares["E D D L"] == pytest.approx((mean[3] - mean[2]) / mean[8], abs=0.01)


def test_a_single_floor_is_comparable_and_a_reflecting_lamp_is_not():
    assert compare(floor()).comparable
    bright = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 0, 3]).rotate([1, 0, 0], 180),
    }
    bright |= {"emitter": {"type": "area", "radiance": 5.0}, "bsdf": {"type": "diffuse"}}
    shares = compare(floor(light=bright)).shares
    assert "E D D D L" in shares
    assert "E D D L" not in shares  # the lamp does not light itself


def test_caustics_are_named():
    ball = {"type": "sphere", "center": [0, 0, 1], "radius": 0.5, "bsdf": {"type": "dielectric"}}
    assert "E D S S L" in compare(floor(ball)).shares


def test_specular_scene_without_diffuse_surfaces_is_comparable():
    ball = {"type": "sphere", "bsdf": {"type": "dielectric"}}
    scene = {"type": "scene", "ball": ball, "sky": {"type": "constant"}, "sensor": {"type": "perspective"}}
    scene["sensor"]["to_world"] = mi.ScalarTransform4f().look_at([0, -4, 0], [0, 0, 0], [0, 0, 1])
    assert compare(mi.load_dict(scene)).comparable


def test_light_through_a_mask_needs_volpath():
    mask = {"type": "mask", "opacity": 0.5, "nested": {"type": "diffuse", "reflectance": 0.0}}
    sheet = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0, 0, 1]), "bsdf": mask}
    point = {"type": "point", "position": [0, 0, 3]}
    scene = floor(sheet, light=point)
    assert has_null(scene)
    assert not has_null(floor())
    assert "volpath" in compare(scene).reason
    assert compare(scene, type="volpath").comparable


def test_mitsubas_own_integrators_are_described():
    assert estimate(mi.load_dict({"type": "path", "max_depth": 5})).max_depth == 5
    assert estimate(mi.load_dict({"type": "path"})).max_depth is None
    assert estimate(mi.load_dict({"type": "volpath"})).crosses_null
    assert not estimate(mi.load_dict({"type": "path"})).crosses_null
    assert estimate(SimpleNamespace(estimates=WHITTED)).holds("ESSDL")
    assert not estimate(SimpleNamespace(estimates=WHITTED)).holds("EDSL")


# Verdicts


def test_path_agrees_with_direct_at_depth_2():
    scene = mi.load_dict(cornell_box())
    before = str(scene)
    found = check(scene, "path:max_depth=2", "direct")
    assert found.verdict == "agree", found
    assert found.assessment.smallest_detectable < 0.01
    assert str(scene) == before


def test_a_missing_bounce_is_rejected():
    found = check(mi.load_dict(cornell_box()), "path:max_depth=8", "path:max_depth=7", spp=16)
    assert found.verdict == "differ"
    assert found.assessment.image.low > 0


def test_a_wrong_weight_is_rejected(scaled):
    scene = mi.load_dict(cornell_box())
    found = check(scene, scaled(1.005), "path:max_depth=8", spp=36)
    assert found.verdict == "differ"
    assert found.assessment.image.inside(0.01)
    assert check(scene, scaled(1.0), "path:max_depth=8", spp=16).verdict == "agree"


def test_too_few_samples_leave_it_undecided():
    found = check(mi.load_dict(cornell_box(32)), "path:max_depth=3", "path:max_depth=3", spp=1, replicates=8)
    assert found.verdict == "undecided"
    assert "more samples" in found.reason


def test_cutoff_is_off_during_a_check_unless_it_was_asked_for(monkeypatch):
    seen = []

    class Cutoff(mi.SamplingIntegrator):
        def __init__(self, props):
            super().__init__(props)
            self.min_contribution = props.get("min_contribution", 0.25)

        def sample(self, scene, sampler, ray, medium=None, active=True):
            seen.append(self.min_contribution)
            return mi.Spectrum(1), mi.Bool(True), []

        def to_string(self):
            return "Cutoff"

    mi.register_integrator("cutoff_in_test", Cutoff)
    scene = mi.load_dict(cornell_box(4))
    used = mi.load_dict({"type": "cutoff_in_test"})
    check(scene, used, "cutoff_in_test", spp=1, replicates=8)
    assert set(seen) == {0.0}
    assert used.min_contribution == 0.25
    seen.clear()
    check(scene, "cutoff_in_test:min_contribution=0.5", {"type": "cutoff_in_test"}, spp=1, replicates=8)
    assert set(seen) == {0.0, 0.5}


@pytest.mark.parametrize(
    "wrong",
    [
        {"spp": 0},
        {"time": 0},
        {"time": float("nan")},
        {"tolerance": 1.5},
        {"level": 0},
        {"replicates": 3},
        {"sensor": 2},
    ],
)
def test_values_out_of_range_are_refused(wrong):
    with pytest.raises(UsageError, match=next(iter(wrong))):
        check(mi.load_dict(cornell_box(8)), "path", "path", **wrong)


# The command


XML = """
<scene version="3.0.0">
    <sensor type="perspective">
        <transform name="to_world"><lookat origin="0, -6, 4" target="0, 0, 1" up="0, 0, 1"/></transform>
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film>
    </sensor>
    <shape type="rectangle"><transform name="to_world"><scale value="4"/></transform></shape>
    <shape type="sphere"><point name="center" x="0" y="0" z="1"/></shape>
    <shape type="sphere">
        <point name="center" x="-2" y="-2" z="6"/>
        <emitter type="area"><rgb name="radiance" value="9"/></emitter>
    </shape>
</scene>
"""


@pytest.fixture
def xml(tmp_path):
    (tmp_path / "ball.xml").write_text(XML)
    return str(tmp_path / "ball.xml")


KEYS = {
    "verdict",
    "level",
    "tolerance",
    "bias",
    "p_value",
    "smallest_detectable_bias",
    "integrators",
    "spp",
    "seconds",
}


@pytest.mark.parametrize(
    ("reference", "spp", "verdict", "code"),
    [
        ("path:max_depth=3", 256, "agree", 0),
        ("path:max_depth=2", 16, "differ", 1),
        ("path:max_depth=3", 1, "undecided", 3),
    ],
)
def test_command(xml, reference, spp, verdict, code):
    from whitted.cli.check import command

    arguments = [
        xml,
        "--integrator",
        "path:max_depth=3",
        "--reference",
        reference,
        "--spp",
        str(spp),
        "--json",
    ]
    result = CliRunner().invoke(command, arguments)
    found = json.loads(result.stdout)
    assert (found["verdict"], result.exit_code) == (verdict, code)
    assert found.keys() >= KEYS
    low, high = found["bias"]["image"]["interval"]
    assert low <= found["bias"]["image"]["value"] <= high


def test_outcome_is_written_and_readable(tmp_path):
    found = check(mi.load_dict(cornell_box(16)), "path:max_depth=2", "path:max_depth=2", spp=16, replicates=8)
    found.write(tmp_path / "found.json")
    assert json.loads((tmp_path / "found.json").read_text()) == found.to_dict()
    for part in (found.verdict, "smallest detectable", "8 replicates x 16 spp"):
        assert part in str(found)
        assert part in found._repr_html_()
