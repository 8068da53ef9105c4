"""Values that are no numbers: none reaches a film, and each is told with its cause, wherever it came from."""

import json

import mitsuba as mi
import numpy as np
import pytest
from studies import finished
from whitted_scenes import camera, transform

import whitted
from whitted import image
from whitted.diagnosis import PIXELS

OURS = ("whitted", "distribution")


def texture(*values):
    """A bitmap of one row of colours, looked up without interpolation."""
    pixels = np.float32(values).reshape(1, -1, 1) * np.ones(3, np.float32)
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True, "filter_type": "nearest"}


def scene(**parts):
    floor = {"type": "rectangle", "to_world": transform().rotate([1, 0, 0], -90).scale(3)}
    return mi.load_dict({"type": "scene", "sensor": camera(), "floor": floor} | parts, optimize=False)


def panel(radiance):
    """A light above the floor, seen by the camera as well."""
    place = transform().translate([0, 1.5, -1]).rotate([1, 0, 0], 30).scale(0.5)
    return {"type": "rectangle", "to_world": place, "emitter": {"type": "area", "radiance": radiance}}


def nan_reflectance():
    class Broken(mi.BSDF):
        def __init__(self, props):
            super().__init__(props)
            self.m_components = [+(mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide)]
            self.m_flags = self.m_components[0]

        def sample(self, ctx, si, sample1, sample2, active=True):
            bs = mi.BSDFSample3f()
            bs.wo = mi.warp.square_to_cosine_hemisphere(sample2)
            bs.pdf = mi.warp.square_to_cosine_hemisphere_pdf(bs.wo)
            bs.eta, bs.sampled_type, bs.sampled_component = 1.0, +mi.BSDFFlags.DiffuseReflection, 0
            return bs, mi.Color3f(float("nan")) & active

        def eval(self, ctx, si, wo, active=True):
            return mi.Color3f(float("nan")) & (active & (wo.z > 0) & (si.wi.z > 0))

        def pdf(self, ctx, si, wo, active=True):
            return mi.Float(1)

        def eval_pdf(self, ctx, si, wo, active=True):
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    mi.register_bsdf("broken_in_test", Broken)
    return {"type": "sphere", "radius": 0.5, "center": [0, 0.5, 0], "bsdf": {"type": "broken_in_test"}}


LIGHT = {"type": "point", "position": [0, 3, 1], "intensity": 5.0}
CASES = {
    "emission": lambda: scene(lamp=panel(texture(1.0, np.inf, 1.0, 1.0))),
    "BSDF": lambda: scene(ball=nan_reflectance(), light=LIGHT),
}


@pytest.mark.parametrize("integrator", OURS)
@pytest.mark.parametrize(("term", "surface"), [("emission", "lamp"), ("BSDF", "ball")])
def test_the_cause_is_told_and_the_picture_is_finite(term, surface, integrator):
    found = whitted.render(CASES[term](), integrator, spp=16)
    assert found.nonfinite > 0
    assert np.isfinite(found.mean).all()
    causes = found.diagnosis.to_dict()
    assert (causes["causes"][0]["term"], causes["causes"][0]["surface"]) == (term, surface)
    assert len(found.diagnosis.traced) == min(causes["pixels"], PIXELS)
    assert sum(cause["samples"] for cause in causes["causes"]) <= found.nonfinite


@pytest.mark.parametrize("integrator", OURS)
def test_every_sample_of_few_pixels_has_a_cause(integrator):
    made = CASES["emission"]()
    found = whitted.render(made, integrator, spp=8, crop=(5, 3, 6, 4))
    assert found.diagnosis.pixels == len(found.diagnosis.traced)
    assert sum(found.diagnosis.causes.values()) == found.nonfinite
    for (x, y), causes in found.diagnosis.traced.items():
        assert 5 <= x < 11
        assert 3 <= y < 7
        assert sum(causes.values()) <= 8


def test_a_finite_picture_has_no_diagnosis():
    found = whitted.render(scene(light=LIGHT), "whitted", spp=1)
    assert (found.nonfinite, found.diagnosis) == (0, None)
    assert found.to_dict()["nonfinite_causes"] is None


@pytest.mark.parametrize("integrator", OURS)
@pytest.mark.parametrize("outer", ["moment", "aov"])
def test_none_reaches_the_film_of_an_integrator_around_ours(integrator, outer):
    nested = {"type": outer, "inner": {"type": integrator}} | ({"aovs": "d:depth"} if outer == "aov" else {})
    made = CASES["emission"]()
    picture = np.array(mi.render(made, integrator=mi.load_dict(nested), spp=4))
    assert np.isfinite(picture[..., :3]).all()
    assert np.isfinite(np.array(mi.render(made, integrator=mi.load_dict({"type": integrator}), spp=4))).all()


def test_the_command_tells_and_exits_with_4(tmp_path):
    glow = np.float32([[[1, 1, 1], [np.nan, 1, 1]]])
    image.write_exr(tmp_path / "glow.exr", image.Picture(image.layer_channels("", glow)))
    (tmp_path / "scene.xml").write_text("""<scene version="3.0.0">
        <sensor type="perspective">
            <transform name="to_world"><lookat origin="0 0 4" target="0 0 0" up="0 1 0"/></transform>
            <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
        </sensor>
        <shape type="rectangle" id="lamp"><emitter type="area"><texture type="bitmap" name="radiance">
            <string name="filename" value="glow.exr"/><boolean name="raw" value="true"/>
            <string name="filter_type" value="nearest"/></texture></emitter></shape>
    </scene>""")
    arguments = (
        "--spp",
        2,
        "-t",
        1,
        "-o",
        tmp_path / "a.exr",
        "--stats",
        tmp_path / "a.json",
        "--debug-nonfinite",
    )
    code, _, err = finished("render", tmp_path / "scene.xml", "--integrator", "whitted", *arguments)
    assert code == 4, err
    assert "emission at lamp" in err
    assert "pixel " in err
    facts = json.loads((tmp_path / "a.json").read_text())
    assert facts["nonfinite"] > 0
    assert facts["nonfinite_causes"]["causes"][0]["term"] == "emission"
