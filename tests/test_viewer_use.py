"""The picture viewer in a real browser: what it reads out, what is chosen, and use by keyboard, touch and in any theme.

Every test also fails if the page writes to the console or asks for anything but itself: see `visit`.
"""

import re

import numpy as np
import pytest
from viewer_page import (
    ENTRIES,
    HEIGHT,
    KNOWN,
    VIEWER,
    WIDTH,
    halves,
    noise,
    open_viewer,
    pixels,
    run,
    screenshot,
    settle,
)

from whitted.reports import pictures
from whitted.reports.pictures import Entry
from whitted.tonemap import tone_map

pytest_plugins = ["browser"]


@pytest.fixture
def show(visit, tmp_path):
    return lambda *entries, **options: open_viewer(visit, tmp_path, *entries, **options)


# Values


def numbers(page):
    """Return the table's rows: heading to a list of numbers, as text, for R, G, B and the error."""
    rows = page.get_by_role("table").locator("tbody tr").all()
    cells = [
        [re.findall(r"[\d.e+-]*\d", cell) for cell in row.locator("td").all_inner_texts()] for row in rows
    ]
    return {row.locator("th").inner_text(): values for row, values in zip(rows, cells, strict=True)}


def hover(page, x, y):
    box = page.locator(".wv-stage").bounding_box()
    page.mouse.move(
        box["x"] + (x + 0.5) / WIDTH * box["width"], box["y"] + (y + 0.5) / HEIGHT * box["height"]
    )


DARKEST = np.unravel_index(KNOWN["r"].max(axis=-1).argmin(), (HEIGHT, WIDTH))[
    ::-1
]  # where relMSE's floor counts


@pytest.mark.parametrize(("x", "y"), [(0, 0), (23, 15), DARKEST])
def test_read_out_is_what_was_put_in(show, x, y):
    page = show()
    settle(page)
    hover(page, x, y)
    rows = numbers(page)
    for heading, entry in zip(["A", "B", "Reference"], ENTRIES, strict=False):
        for channel in range(3):
            value, *spread = rows[heading][channel]
            assert value == f"{KNOWN[entry.id][y, x, channel]:#.4g}"
            assert float(value) == pytest.approx(entry.radiance[y, x, channel], rel=2**-13 + 5e-4)
            if entry.stderr is not None:
                assert float(spread[0]) == pytest.approx(entry.stderr[y, x, channel], rel=2**-7 + 5e-2)
    a, r = (KNOWN[name][y, x].astype(float) for name in "ar")
    error = np.sqrt(np.mean((a - r) ** 2 / (r**2 + 0.01 * KNOWN["r"].mean(dtype=float) ** 2)))
    assert float(rows["A"][3][0]) == pytest.approx(100 * error, rel=0.05)


def test_pixel_for_scripts(show):
    page = show()
    pixel = run(page, "pixel(7, 3)")
    for name, key in [("a", "a"), ("b", "b"), ("r", "reference")]:
        assert pixel[key] == KNOWN[name][3, 7].tolist()
    for entry in ENTRIES[:2]:
        assert pixel["stderr"][entry.id] == pytest.approx(entry.stderr[3, 7].tolist(), rel=2**-7)
    run(page, "show('d', 'c')")
    assert run(page, "pixel(39, 7)") == {
        "a": KNOWN["d"][7, 39].tolist(),
        "b": KNOWN["c"][7, 39].tolist(),
        "reference": None,
        "stderr": {"a": None, "b": None},
    }


def test_touch_reads_a_pixel(show):
    page = show(has_touch=True)
    settle(page)
    box = page.locator(".wv-stage").bounding_box()
    page.touchscreen.tap(box["x"] + 0.2 * box["width"], box["y"] + 0.8 * box["height"])
    page.wait_for_function(f"{VIEWER}.state().cursor !== null")
    assert run(page, "state().cursor") == [int(0.2 * WIDTH), int(0.8 * HEIGHT)]


# Choices


def test_scenes_keep_the_choice(show, tmp_path):
    page = show()
    page.get_by_role("combobox", name="B, right").select_option("r")
    page.get_by_role("combobox", name="A, left").select_option("b")
    page.wait_for_function(f"{VIEWER}.state().a === 'b'")
    assert run(page, "state()")["b"] == "r"
    page.get_by_role("combobox", name="Scene").select_option("wide")
    page.wait_for_function(f"{VIEWER}.state().scene === 'wide'")
    settle(page)
    assert [run(page, f"state().{side}") for side in "ab"] == [
        "c",
        "d",
    ]  # "path" is there again, "second" isn't
    names = page.get_by_role("combobox", name="A, left").locator("option").all_inner_texts()
    assert names == ["first, 16 spp", "path"]
    expected = halves(tone_map(KNOWN["c"]), tone_map(KNOWN["d"]), 20)
    assert (pixels(page, tmp_path, 8, 40) == expected).all()


def test_the_last_choice_wins(show):
    page = show()
    page.evaluate(
        f"(() => {{ const v = {VIEWER}; v.show('c', 'd'); v.show('r', 'b'); return v.show('b', 'a') }})()"
    )
    page.wait_for_timeout(100)
    assert {key: run(page, "state()")[key] for key in ("scene", "a", "b")} == {
        "scene": "box",
        "a": "b",
        "b": "a",
    }


def test_only_what_is_shown_is_decoded(show):
    """Damaged data of another picture harms nothing until it is shown."""
    damage = lambda html: re.sub(r'(id="picture-d">).*?<', r"\1!<", html)  # noqa: E731
    page = show(change=damage)
    settle(page)
    run(page, "show('r', 'b')")
    assert page.evaluate(f"{VIEWER}.show('c', 'd').catch((error) => error.name)") == "InvalidCharacterError"


def test_the_last_few_are_kept_decoded(show):
    """Eight: the ninth takes the place of the one that was not shown for longest."""
    names = [f"p{i}" for i in range(9)]
    page = show([Entry(name, name, "s", noise(1), "Noise.") for name in names])
    for name in [*names[:8], "p0", "p8"]:
        page.evaluate(f"{VIEWER}.show('{name}', '{name}')")
    page.evaluate("document.querySelectorAll('[id^=picture-]').forEach((data) => { data.textContent = '!' })")
    again = f"(name) => {VIEWER}.show(name, name).then(() => 'shown', () => 'lost')"
    assert {name: page.evaluate(again, name) for name in ("p8", "p0", "p2", "p1")} == {
        "p8": "shown",
        "p0": "shown",
        "p2": "shown",
        "p1": "lost",
    }


def test_two_viewers_in_a_page(show):
    other = pictures.viewer([Entry("z", "z", "s", noise(9), "Other.")], "others")
    page = show(
        change=lambda html: html.replace(
            '<div class="whitted-viewer"', other + '<div class="whitted-viewer"', 1
        )
    )
    one, two = (f"document.querySelectorAll('.whitted-viewer')[{i}].viewer" for i in (0, 1))
    for viewer in (one, two):
        page.evaluate(f"{viewer}.ready")
    assert page.evaluate(f"[{one}.state().a, {two}.state().a]") == ["z", "a"]


# Keyboard and other aids


def test_keyboard_alone(show):
    page = show()
    settle(page)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.getAttribute('role')") == "application"
    page.keyboard.press("p")
    assert run(page, "state().cursor") == [WIDTH // 2, HEIGHT // 2]
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowUp")
    page.keyboard.press("Shift+ArrowUp")
    assert run(page, "state().cursor") == [WIDTH // 2 + 1, 0]
    said = page.get_by_role("status").inner_text()
    assert said.startswith(f"Pixel {WIDTH // 2 + 1}, 0. A: {KNOWN['a'][0, WIDTH // 2 + 1, 0]:#.4g}, ")
    assert float(numbers(page)["B"][2][0]) == pytest.approx(KNOWN["b"][0, WIDTH // 2 + 1, 2], rel=5e-4)
    page.keyboard.press("Escape")
    assert run(page, "state().cursor") is None

    for _ in range(3):
        page.keyboard.press("e")
    page.keyboard.press("E")
    assert run(page, "state().exposure") == 1
    assert page.get_by_role("status").inner_text() == "Exposure +1 stop"
    page.keyboard.press("3")
    page.wait_for_function(f"{VIEWER}.state().a === 'r'")
    page.keyboard.press("Shift+Digit1")
    page.wait_for_function(f"{VIEWER}.state().b === 'a'")
    page.keyboard.press("9")  # there are three
    assert [run(page, f"state().{side}") for side in "ab"] == ["r", "a"]
    for key in ("f", "r"):  # OpenSeadragon would mirror and turn the picture
        page.keyboard.press(key)
    settle(page)
    assert page.evaluate(
        f"[{VIEWER}.stage.viewer.viewport.getFlip(), {VIEWER}.stage.viewer.viewport.getRotation()]"
    ) == [
        False,
        0,
    ]
    assert run(page, "state().exposure") == 0


def test_the_cursor_is_brought_into_view(show):
    page = show()
    settle(page)
    run(page, "stage.zoomBy(1.5)")
    settle(page)
    run(page, "setCursor([0, 0])")
    settle(page)
    stage, cursor = (page.locator(name).bounding_box() for name in (".wv-stage", ".wv-cursor"))
    for start, size in (("x", "width"), ("y", "height")):
        assert stage[start] <= cursor[start] + cursor[size] / 2 <= stage[start] + stage[size]


FOCUSED = """() => {
    const { activeElement: focused } = document, box = focused.getBoundingClientRect();
    const clip = { x: box.x - 6, y: box.y - 6, width: box.width + 12, height: box.height + 12 };
    return [focused.dataset.part ?? focused.className + focused.tagName, clip];
}"""
WITHOUT_FOCUS = ":focus, :has(:focus) { outline: none !important } .wv-divider { --wv-grip: #fff !important }"


def test_every_control_is_reached_and_shows_the_focus(show, tmp_path):
    page = show(viewport={"width": 1000, "height": 1400})
    settle(page)
    controls = page.locator(".whitted-viewer").locator("button, select, input, summary, [tabindex='0']")
    reached = set()
    for _ in range(controls.count()):
        page.keyboard.press("Tab")
        name, box = page.evaluate(FOCUSED)
        with_focus = screenshot(page, tmp_path, clip=box).astype(int)
        page.add_style_tag(content=WITHOUT_FOCUS)
        without = screenshot(page, tmp_path, clip=box)
        page.locator("style").last.evaluate("(style) => style.remove()")
        changed = np.abs(with_focus - without).max(axis=-1) > 50
        assert changed.sum() > 60, name
        reached.add(name)
    assert len(reached) == controls.count()


CONTRASTS = r"""() => {
    const luminance = ([r, g, b]) => [[r, 0.2126], [g, 0.7152], [b, 0.0722]].reduce((sum, [value, weight]) => {
        const v = value / 255;
        return sum + weight * (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    }, 0);
    const colour = (text) => text.match(/[\d.]+/g).map(Number);
    const ground = (element) => {
        const rgba = colour(getComputedStyle(element).backgroundColor);
        return rgba[3] === 0 ? ground(element.parentElement) : rgba;
    };
    const hasText = (e) => [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
    const elements = [...document.querySelectorAll(".whitted-viewer *")].filter((e) => e.checkVisibility());
    return elements.filter((e) => e.tagName === "SELECT" || hasText(e) && e.tagName !== "OPTION").map((e) => {
        const [a, b] = [colour(getComputedStyle(e).color), ground(e)].map(luminance);
        return [e.tagName + "." + e.className, (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), b];
    });
}"""


@pytest.mark.parametrize(
    ("system", "page_theme", "dark"),
    [("light", None, False), ("dark", None, True), ("light", "dark", True), ("dark", "light", False)],
)
def test_contrast(show, system, page_theme, dark):
    theme = f' data-theme="{page_theme}"' if page_theme else ""
    page = show(color_scheme=system, change=lambda html: html.replace("<html", f"<html{theme}"))
    settle(page)
    run(page, "setMode('error')")
    run(page, "setCursor([3, 3])")
    page.locator("summary").click()
    found = page.evaluate(CONTRASTS)
    assert len(found) > 40
    assert [(name, ratio) for name, ratio, _ in found if ratio < 4.5] == []
    caption = next(ground for name, _, ground in found if name.startswith("CAPTION"))
    assert (caption < 0.1) == dark


@pytest.mark.parametrize("width", [320, 400, 1400])
def test_fits_its_window(show, width):
    page = show(viewport={"width": width, "height": 900})
    settle(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    stage, panel = (page.locator(name).bounding_box() for name in (".wv-stage", ".wv-panel"))
    assert (panel["x"] > stage["x"] + stage["width"]) == (width == 1400)  # beside it, else below
    assert stage["width"] / stage["height"] == pytest.approx(WIDTH / HEIGHT, rel=0.02)


def test_the_recorder_hears(chromium, record, tmp_path):
    path = tmp_path / "loud.html"
    path.write_text("<script>console.log('hear', 1); new Image().src = 'x.png'; throw Error('no')</script>")
    page = chromium.new_page()
    record.watch(page)
    page.goto(path.as_uri())
    page.close()
    assert record.console[0] == "hear 1"
    assert record.errors == ["no"]
    assert record.requests == [path.as_uri(), (tmp_path / "x.png").as_uri()]
