"""A study's report in a real browser: its plots draw, its numbers are the study's, and it keeps to itself."""

import itertools
import json
import re

import numpy as np
import pytest
from commands import refused
from studies import TOY, finished, rows

from whitted import image
from whitted.reports import page as report
from whitted.studies.analysis import analyse
from whitted.studies.store import Store
from whitted.studies.study import study

pytest_plugins = ["browser"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A small study with noise shares, and its report."""
    folder = tmp_path_factory.mktemp("report")
    spec = TOY | {"shares": 8, "width": 24, "replicates": 4, "spp": [1, 4, 16], "metrics": ["mse", "smape"]}
    spec |= {"title": "A <title> & more", "description": "What it asks."}
    found = study(spec, folder / "toy")
    report.write(found.folder, folder / "toy.html", errors=[0.3])
    return found.folder, folder / "toy.html"


@pytest.fixture
def page(made, visit):
    return visit(made[1])


def drawn(page):
    """Wait until all plots are drawn."""
    for plot in page.query_selector_all(".plot"):
        plot.scroll_into_view_if_needed()
        page.wait_for_function("plot => plot.querySelector('.main-svg .trace, .main-svg .bars')", arg=plot)


def test_every_plot_is_drawn_with_a_line_for_each_method(page):
    drawn(page)
    plots = page.query_selector_all(".plot")
    assert [plot.get_attribute("id") for plot in plots] == ["errors-seconds-0", "errors-spp-0", "shares-0"]
    for plot in plots[:2]:
        assert len(plot.query_selector_all(".scatterlayer .lines .js-line")) >= 3
        assert plot.query_selector_all(".scatterlayer .points path")
    assert plots[2].query_selector_all(".bars path")


def test_the_points_are_the_errors_of_the_store(made, page):
    drawn(page)
    data = page.evaluate(
        "document.getElementById('errors-spp-0').data.filter(t => t.name).map(t => [t.name, t.x, t.y])"
    )
    found = rows(
        made[0],
        "SELECT methods.label, cells.spp, avg(value - reference_part) FROM cells JOIN errors ON cell = key"
        " JOIN methods ON methods.id = cells.method WHERE metric = 'mse' AND role = 'cell' GROUP BY 1, 2",
    )
    expected = {(label, spp): np.sqrt(mse) for label, spp, mse in found}
    shown = {(name, x): y for name, xs, ys in data for x, y in zip(xs, ys, strict=True)}
    assert shown == pytest.approx(expected)


def test_the_tables_have_what_the_analysis_found(made, page):
    with Store(made[0]) as store:
        (scene,) = analyse(store, [0.3])
    text = page.inner_text("main")
    for name, slope in scene.slopes.items():
        assert str(slope.interval) in text, name
        assert str(scene.parts[name].variance) in text
    for found in (*scene.ratios.values(), *scene.efficiencies.values()):
        assert str(found) in text
    assert "30 %" in text
    choice = scene.cheapest[0.3]
    assert choice is None or choice.name in text
    assert page.inner_text("h1") == "A <title> & more"


def test_the_read_out_agrees_with_the_picture_files(made, page):
    page.wait_for_function("document.querySelector('.whitted-viewer').viewer")
    page.evaluate("document.querySelector('.whitted-viewer').viewer.ready")
    entries = json.loads(
        page.inner_text("#pictures") or page.evaluate("document.getElementById('pictures').textContent")
    )
    names = {entry["name"] for entry in entries}
    assert names == {
        "distribution:max_depth=2",
        "path:max_depth=2, independent",
        "path:max_depth=2, owen_sobol",
        "reference",
    }
    entry = next(e for e in entries if e["name"].startswith("path") and e["spp"] == 16)
    path = rows(
        made[0],
        "SELECT cells.picture FROM cells JOIN methods ON methods.id = cells.method"
        " WHERE label = ? AND cells.spp = 16 AND replicate = 0",
        entry["name"],
    )[0][0]
    pixels = image.read(made[0] / path).rgb
    script = """([id, x, y]) => { const viewer = document.querySelector('.whitted-viewer').viewer;
        return viewer.show(id, id).then(() => viewer.pixel(x, y).a); }"""
    for x, y in ((0, 0), (7, 13), (23, 23)):
        found = page.evaluate(script, [entry["id"], x, y])
        np.testing.assert_allclose(found, pixels[y, x], rtol=2**-12)


def test_the_slider_moves_and_splits_the_pictures(page):
    page.wait_for_function("document.querySelector('.whitted-viewer').viewer")
    page.evaluate("document.querySelector('.whitted-viewer').viewer.ready")
    slider = page.locator(".whitted-viewer [data-part=divider]")
    before = float(slider.input_value())
    slider.focus()
    page.keyboard.press("ArrowLeft")
    assert float(slider.input_value()) < before


def contrast(page):
    """The lowest contrast of text against the page, by WCAG's formula."""
    return page.evaluate(
        """() => {
        const canvas = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
        const rgb = (colour) => { canvas.fillStyle = colour; canvas.fillRect(0, 0, 1, 1);
            return [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3); };
        const light = (colour) => rgb(colour).map((v) => v / 255)
            .map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
            .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
        const ground = light(getComputedStyle(document.body).backgroundColor);
        const texts = document.querySelectorAll('h1, h2, h3, p, td, th, summary, a:not(.skip), figcaption');
        return Math.min(...[...texts].map((e) => light(getComputedStyle(e).color))
            .map((l) => (Math.max(l, ground) + 0.05) / (Math.min(l, ground) + 0.05)));
    }"""
    )


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_both_schemes_have_contrast_and_the_button_changes_them(made, visit, scheme):
    page = visit(made[1], color_scheme=scheme)
    drawn(page)
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (max(map(int, re.findall(r"\d+", ground))) > 128) == (scheme == "light")
    assert contrast(page) >= 4.5
    ink = page.evaluate("document.querySelector('.xtitle').style.fill")
    page.click("#theme")
    page.wait_for_function("ink => document.querySelector('.xtitle').style.fill !== ink", arg=ink)
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != ground
    assert contrast(page) >= 4.5


def test_it_can_be_read_without_seeing_it(page):
    drawn(page)
    for plot in page.query_selector_all(".plot"):
        assert plot.get_attribute("role") == "img"
        assert len(plot.get_attribute("aria-label")) > 40
    assert page.evaluate("[...document.images].every((picture) => picture.alt.length > 20)")
    assert page.evaluate("[...document.querySelectorAll('th')].every((th) => th.scope)")
    levels = page.evaluate("[...document.querySelectorAll('h1, h2, h3')].map((h) => +h.tagName[1])")
    assert levels[0] == 1
    assert all(b <= a + 1 for a, b in itertools.pairwise(levels))
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"


def test_a_narrow_window_needs_no_sideways_scrolling(made, visit):
    page = visit(made[1], viewport={"width": 400, "height": 800})
    drawn(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= 400


def test_a_study_that_has_only_begun_has_a_report_too(tmp_path, visit):
    begun = study(TOY, tmp_path / "begun", time=1e-3)
    report.write(begun.folder, tmp_path / "begun.html")
    assert "No setting is finished yet" in visit(tmp_path / "begun.html").inner_text("main")


def test_without_seconds_costs_are_samples(tmp_path, visit):
    found = study(TOY | {"timed": 0}, tmp_path / "untimed")
    report.write(found.folder, tmp_path / "untimed.html")
    page = visit(tmp_path / "untimed.html")
    drawn(page)
    assert [plot.get_attribute("id") for plot in page.query_selector_all(".plot")] == ["errors-spp-0"]
    assert "samples per pixel" in page.inner_text(".headline")


def test_the_command(made, tmp_path):
    code, out, err = finished("report", made[0], "-o", tmp_path / "r.html", "--error", "0.3")
    assert (code, err) == (0, "")
    assert re.fullmatch(rf"{re.escape(str(tmp_path))}/r.html: \d+\.\d MB\n", out)
    assert (tmp_path / "r.html").read_text().count("<h2") >= 3
    refused(finished("report", tmp_path), "no study lies there")
    refused(finished("report", made[0], "-o", tmp_path / "none/r.html"), "does not exist")
    refused(finished("report", made[0], "-o", "r.pdf", cwd=tmp_path), "does not end in .html")
    refused(finished("report", made[0], "--error", "-1", cwd=tmp_path), "--error")
