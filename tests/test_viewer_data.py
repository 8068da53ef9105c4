"""Pictures as text in a page: what is kept of the numbers, what it takes, and whether the built viewer is current."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from whitted.reports import page, pictures
from whitted.reports.pictures import Entry

WEB = Path(__file__).parent.parent / "web"


def noise(height=32, width=48, channels=3, seed=1):
    return np.random.default_rng(seed).lognormal(-1, 2, (height, width, channels)).astype(np.float32)


def entry(**changes):
    return replace(Entry("a", "name", "scene", noise(), "text"), **changes)


@pytest.mark.parametrize("bits", [3, 6, 12, 22])
@pytest.mark.parametrize("sign", [1, -1])
def test_relative_error(bits, sign):
    values = sign * noise(128, 128)
    back = pictures.decode(pictures.encode(values, bits), values.shape)
    error = np.abs(back / values.astype(np.float64) - 1).max()
    assert error <= 2.0 ** -(bits + 1)
    assert error > 2.0 ** -(bits + 1.1)  # and no more bits are kept


def test_numbers_of_few_bits_are_kept_exactly():
    values = np.array([0.0, -0.0, 1, -1, 0.5, 4095, 2.0**-126, 2.0**127, np.inf, -np.inf], np.float32)
    back = pictures.decode(pictures.encode(values[None, :, None]), values.shape)
    assert (back.view(np.uint32) == values.view(np.uint32)).all()


def test_nan_of_any_kind_stays_nan():
    words = np.array([0x7FC00000, 0x7F800001, 0x7FFFFFFF, 0xFFC00000, 0xFFFFFFFF], np.uint32)
    back = pictures.decode(pictures.encode(words.view(np.float32)[None, :, None]), words.shape)
    assert np.isnan(back).all()


def test_large_numbers_stay_finite_and_small_ones_near():
    largest = np.finfo(np.float32).max
    values = np.array([largest, -largest, 1e-39, -1e-44, 1e-45], np.float32)
    back = pictures.decode(pictures.encode(values[None, :, None]), values.shape).astype(np.float64)
    assert back[:2] == pytest.approx([largest, -largest], rel=2**-12)
    assert np.abs(back[2:] - values[2:]).max() <= 2.0**-139


def test_other_types_and_layouts():
    values = noise().astype(np.float64)
    upside_down = values[::-1].transpose(1, 0, 2)
    back = pictures.decode(pictures.encode(upside_down), upside_down.shape)
    assert back == pytest.approx(upside_down, rel=2**-13)


def test_size_of_noise():
    values = np.exp(0.2 * np.random.default_rng(1).standard_normal((128, 128, 3))).astype(np.float32)
    kept, nearly_all = (len(pictures.encode(values, bits)) for bits in (12, 22))
    assert kept < 0.6 * values.nbytes  # although base64 adds a third
    assert kept < 0.6 * nearly_all


def test_names_are_text():
    wild = '</script><script>alert("1")</script>&amp;<!--'
    html = pictures.viewer([entry(name=wild, group=wild, text=wild)])
    assert html.count("</script>") == 2  # the manifest and a picture
    assert "<!--" not in html
    manifest = json.loads(html.split('class="whitted-viewer-data">')[1].split("</script>")[0])
    assert [manifest[0][key] for key in ("name", "group", "text")] == [wild] * 3


@pytest.mark.parametrize(
    ("entries", "complaint"),
    [
        ([], "needs a picture"),
        ([entry(), entry()], "more than once: a"),
        ([entry(id='"><b>')], "letters"),
        ([entry(), entry(id="b", radiance=noise(31))], r"b: .*\(31, 48, 3\).*\(32, 48, 3\)"),
        ([entry(radiance=noise(channels=2))], r"a: .*\(32, 48, 2\)"),
        ([entry(radiance=noise()[..., 0])], r"a: .*\(32, 48\)"),
        ([entry(seconds=float("nan"))], "not JSON compliant"),
        ([entry(stderr=noise(31))], r"a: .*standard error .*\(31, 48, 3\)"),
        ([entry(reference="c")], "a: .*reference c"),
        ([entry(reference="b"), entry(id="b", group="other")], "a: .*reference b"),
    ],
)
def test_what_cannot_be_shown(entries, complaint):
    with pytest.raises(ValueError, match=complaint):
        pictures.viewer(entries)


def test_built_from_these_sources():
    """`make viewer` was run after the last change: the file names the hash of its sources and the versions."""
    sources = b"".join(path.read_bytes() for path in sorted((WEB / "src").iterdir()))
    head = pictures.script()[:1000]
    assert hashlib.sha256(sources).hexdigest() in head
    pinned = json.loads((WEB / "package.json").read_text())["dependencies"]
    plotly = pinned.pop("plotly.js-basic-dist-min")
    assert pinned
    assert all(f"{name} {version} (" in head for name, version in pinned.items())
    assert f"plotly.js (basic - minified) v{plotly}\n" in page._asset("plotly.js")[:200]


def test_assets_end_no_element():
    assert [pictures.script().count(text) for text in ("</script", "<!--")] == [1, 0]
    assert pictures.style().count("</style") == 1
    assert not any(text in page._asset("plotly.js") for text in ("</script", "<!--"))


def test_lock_names_no_host():
    lock = json.loads((WEB / "package-lock.json").read_text())
    assert not any("resolved" in package for package in lock["packages"].values())
