"""The picture viewer in a real browser: what it draws, in colours and in errors, moved and enlarged.

Every test also fails if the page writes to the console or asks for anything but itself: see `visit`.
"""

import re

import numpy as np
import pytest
from viewer_page import (
    HEIGHT,
    KNOWN,
    WIDTH,
    drawn,
    focus_picture,
    halves,
    noise,
    open_viewer,
    pixels,
    run,
    settle,
)

from whitted.reports import pictures
from whitted.reports.pictures import Entry
from whitted.tonemap import tone_map

pytest_plugins = ["browser"]

VIRIDIS = {0: "440154", 85: "31688e", 170: "35b779", 255: "fde725"}  # of 256, from matplotlib's table


@pytest.fixture
def show(visit, tmp_path):
    return lambda *entries, **options: open_viewer(visit, tmp_path, *entries, **options)


# What is drawn


@pytest.mark.parametrize("exposure", [-3.5, 0, 2])
def test_colours_are_srgb(show, tmp_path, exposure):
    page = show()
    run(page, f"setExposure({exposure})")
    expected = halves(tone_map(KNOWN["a"], exposure), tone_map(KNOWN["b"], exposure), WIDTH // 2)
    assert (pixels(page, tmp_path) == expected).all()


def test_special_values(show, tmp_path):
    radiance = np.full((HEIGHT, WIDTH, 3), 0.18, np.float32)
    radiance[0, :6, 0] = [np.nan, np.inf, -np.inf, -1, 0, 0.0031308]
    page = show([Entry("a", "a", "s", radiance, "Grey.")])
    assert pixels(page, tmp_path)[0, :6, 0].tolist() == [0, 255, 0, 0, 0, 10]
    assert (pixels(page, tmp_path)[1:] == 118).all()


def test_one_channel(show, tmp_path):
    radiance = noise(1, channels=1)
    page = show([Entry("a", "a", "s", radiance, "Grey.")])
    known = pictures.decode(pictures.encode(radiance), radiance.shape)
    assert (pixels(page, tmp_path) == tone_map(np.repeat(known, 3, axis=-1))).all()
    assert run(page, "pixel(3, 4).a") == known[4, 3].tolist()


def test_divider_parts_the_pictures(show, tmp_path):
    page = show()
    a, b = (tone_map(KNOWN[name]) for name in "ab")
    divider = page.get_by_role("slider", name="Divider")
    for act, column in [
        (lambda: run(page, "setSlider(0.25)"), WIDTH // 4),
        (lambda: divider.press("End"), WIDTH),
        (lambda: divider.press("Home"), 0),
    ]:
        act()
        assert (pixels(page, tmp_path) == halves(a, b, column)).all()
        assert run(page, "state().slider") == column / WIDTH


def test_divider_is_dragged(show, tmp_path):
    page = show()
    box = page.locator(".wv-stage").bounding_box()
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] / 2, middle)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.75, middle, steps=5)
    page.mouse.up()
    assert run(page, "state().slider") == pytest.approx(0.75, abs=0.01)
    expected = halves(tone_map(KNOWN["a"]), tone_map(KNOWN["b"]), WIDTH * 3 // 4)
    assert (pixels(page, tmp_path) == expected).all()


# Errors


def off_by(factor, stderr=0.0, reference="r"):
    """Return constant pictures of known relative errors, A above and B below, and their reference, R = 0.5.

    relMSE's denominator is R^2 + 0.01 mean(R)^2, that is 1.01 R^2.
    """
    right = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    unit = right * np.sqrt(1.01, dtype=np.float32)
    return [
        Entry("a", "a", "s", right + factor * unit, "Too bright.", stderr * unit, reference),
        Entry("b", "b", "s", right - factor * unit, "Too dark.", None, reference),
        Entry("r", "r", "s", right, "Right."),
    ]


def shown_as(index):
    """Return the relative error in the middle of one of the 256 steps from 0.1 % to 100 %."""
    return 10 ** (3 * ((index + 0.5) / 256 - 1))


def hexadecimal(colour):
    return "".join(f"{value:02x}" for value in colour)


@pytest.mark.parametrize(("index", "exposure"), [(0, 0), (85, 0), (170, 0), (170, 2), (255, -1.5)])
def test_colour_of_a_known_error(show, tmp_path, index, exposure):
    page = show(off_by(shown_as(index) / 2**exposure))
    page.get_by_role("combobox", name="Display").select_option("error")
    page.get_by_role("slider", name="Sensitivity").fill(str(exposure))
    colours = pixels(page, tmp_path)
    assert hexadecimal(colours[0, 0]) == VIRIDIS[index]
    assert (colours == colours[0, 0]).all()
    ends = page.get_by_role("img", name="Colour bar").get_attribute("aria-label")
    numbers = [float(number) / 100 for number in re.findall(r"([\d.e-]+) %", ends)]
    assert numbers == pytest.approx([1e-3 / 2**exposure, 1 / 2**exposure], rel=0.05)


def test_signed_error(show, tmp_path):
    page = show(off_by(0.125))
    run(page, "setMode('signed')")
    colours = pixels(page, tmp_path).astype(int)
    brighter, darker = colours[0, 0], colours[0, -1]
    assert brighter[0] > brighter[2] + 50
    assert darker[2] > darker[0] + 50
    run(page, "show('r', 'a')")
    assert pixels(page, tmp_path)[0, 0].min() > 230  # no error is nearly white


@pytest.mark.parametrize("reference", ["r", None])
def test_standard_error(show, tmp_path, reference):
    """Relative to the reference, else to the picture itself, which is the same here."""
    page = show(off_by(0, shown_as(170), reference))
    page.get_by_role("combobox", name="Display").select_option("stderr")
    colours = pixels(page, tmp_path)
    assert hexadecimal(colours[0, 0]) == VIRIDIS[170]
    assert (colours[:, -1] == 128).all()  # B has none


def test_displays_that_have_nothing_to_show(show):
    page = show()
    options = page.get_by_role("combobox", name="Display").locator("option")
    disabled = lambda: [option.get_attribute("value") for option in options.all() if option.is_disabled()]  # noqa: E731
    assert disabled() == []
    run(page, "setMode('error')")
    run(page, "show('c', 'd')")
    assert disabled() == ["error", "signed", "stderr"]
    assert run(page, "state().mode") == "colour"


# Zoom and pan


def zoom_by_wheel(page):
    page.mouse.move(200, 200)
    page.keyboard.down("Control")
    page.mouse.wheel(0, -300)
    page.keyboard.up("Control")


def zoom_and_drag(page):
    page.get_by_role("button", name="Zoom in").click()
    page.mouse.move(300, 200)
    page.mouse.down()
    page.mouse.move(220, 170, steps=5)
    page.mouse.up()
    page.wait_for_timeout(200)


def zoom_by_keys(page):
    focus_picture(page)
    for _ in range(3):
        page.keyboard.press("+")
        page.wait_for_timeout(200)
    page.keyboard.press("ArrowRight")


def test_the_wheel_alone_scrolls_the_page(show):
    page = show(viewport={"width": 1000, "height": 300})
    settle(page)
    before = run(page, "state().zoom")
    page.mouse.move(200, 200)
    page.mouse.wheel(0, 100)
    page.wait_for_function("window.scrollY > 0")
    assert run(page, "state().zoom") == before


@pytest.mark.parametrize("act", [zoom_by_wheel, zoom_and_drag, zoom_by_keys])
def test_zoom_and_pan_in_step(show, tmp_path, act):
    """At points of the screen on both sides, the colour is that of the pixel which the read-out names there."""
    page = show()
    settle(page)
    before = run(page, "state().zoom")
    act(page)
    image, corner = drawn(page, tmp_path)
    assert run(page, "state().zoom") > 1.15 * before
    shown = {name: tone_map(KNOWN[name]) for name in "ab"}
    moved = 0
    for share, name in [(0.1, "a"), (0.3, "a"), (0.45, "a"), (0.55, "b"), (0.7, "b"), (0.95, "b")]:
        at_x, at_y = int(share * image.shape[1]), int(0.6 * image.shape[0])
        page.mouse.move(corner[0] + at_x + 0.5, corner[1] + at_y + 0.5)
        x, y = map(int, re.search(r"x (\d+), y (\d+)", page.get_by_role("table").inner_text()).groups())
        assert (image[at_y, at_x] == shown[name][y, x]).all()
        moved += (x, y) != (int(share * WIDTH), int(0.6 * HEIGHT))
    assert moved > 1


def test_one_to_one_fit_and_reset(show):
    page = show()
    settle(page)
    whole = run(page, "state()")
    page.get_by_role("button", name="1:1").click()
    settle(page)
    assert run(page, "state().zoom") == pytest.approx(1, rel=1e-6)
    page.get_by_role("button", name="Fit").click()
    settle(page)
    assert run(page, "state().zoom") == pytest.approx(whole["zoom"], rel=1e-6)
    for call in (
        "setMode('signed')",
        "setExposure(5)",
        "setSlider(0.1)",
        "setCursor([1, 2])",
        "stage.zoomBy(3)",
    ):
        run(page, call)
    page.get_by_role("button", name="Reset").click()
    settle(page)
    assert run(page, "state()") == whole


def test_one_to_one_is_pixel_by_pixel(show, tmp_path):
    radiance = noise(1, 150, 200)
    page = show([Entry("a", "a", "s", radiance, "Noise.")])
    page.get_by_role("button", name="1:1").click()
    image, _ = drawn(page, tmp_path)
    expected = tone_map(pictures.decode(pictures.encode(radiance), radiance.shape))
    top, left = ((image.shape[axis] - radiance.shape[axis]) // 2 for axis in (0, 1))
    places = [(top + i, left + j) for i in (0, 1) for j in (0, 1)]
    assert any((image[y : y + 150, x : x + 200] == expected).all() for y, x in places)


def test_enlarged_pixels_are_square(show, tmp_path):
    page = show()
    page.get_by_role("button", name="Zoom in").click()
    image, _ = drawn(page, tmp_path)
    colours = {tuple(colour) for colour in image.reshape(-1, 3)}
    known = {tuple(colour) for name in "ab" for colour in tone_map(KNOWN[name]).reshape(-1, 3)}
    assert colours <= known  # none in between
