"""A page with a viewer of two small scenes, and what a browser shows of it."""

import mitsuba as mi
import numpy as np

from whitted.reports import pictures
from whitted.reports.pictures import Entry

HEIGHT, WIDTH = 16, 24
VIEWER = "document.querySelector('.whitted-viewer').viewer"


def noise(seed, height=HEIGHT, width=WIDTH, channels=3):
    return np.random.default_rng(seed).lognormal(-1, 1, (height, width, channels)).astype(np.float32)


REFERENCE = noise(0)
ENTRIES = [
    Entry("a", "first", "box", REFERENCE * noise(1), "A box.", 0.1 * noise(2), "r", spp=16, seconds=0.25),
    Entry("b", "second", "box", REFERENCE * noise(3), "A noisy box.", 0.1 * noise(4), "r", spp=64),
    Entry("r", "path", "box", REFERENCE, "A clean box."),
    Entry("c", "first", "wide", noise(5, 8, 40), "A wall.", spp=16),
    Entry("d", "path", "wide", noise(6, 8, 40), "A clean wall."),
]
KNOWN = {
    entry.id: pictures.decode(pictures.encode(entry.radiance), entry.radiance.shape) for entry in ENTRIES
}


def open_viewer(visit, folder, entries=ENTRIES, change=lambda html: html, **options):
    """Open a page with a viewer of some entries, in a window of these options; return when the first pictures are read.

    ``change`` gets the page's HTML and returns what is written.
    """
    head = '<!doctype html><html lang="en"><meta charset="utf-8"><title>Pictures</title>'
    sizes = '<meta name="viewport" content="width=device-width"><style>body { margin: 16px }</style>'
    html = head + sizes + pictures.style() + pictures.viewer(entries) + pictures.script()
    path = folder / "page.html"
    path.write_text(change(html), "utf-8")
    page = visit(path, **options)
    run(page, "ready")
    return page


def settle(page):
    """Wait until both pictures are drawn and have not moved for some frames: a key goes on a while after it is up."""
    page.evaluate(
        f"""async () => {{
            const {{ viewer }} = {VIEWER}.stage, frame = () => new Promise(requestAnimationFrame);
            const isLoaded = () => [0, 1].every((i) => viewer.world.getItemAt(i)?.getFullyLoaded());
            const view = () => JSON.stringify(viewer.viewport.getBounds(true));
            for (let still = 0, last = view(); still < 15; last = view()) {{
                await frame();
                still = isLoaded() && view() === last ? still + 1 : 0;
            }}
        }}"""
    )


def screenshot(page, folder, **options):
    """Return a part of the window, [height, width, 3]; the options are Playwright's."""
    page.screenshot(path=folder / "screenshot.png", **options)
    return np.array(mi.Bitmap(str(folder / "screenshot.png")))[..., :3]


def drawn(page, folder):
    """Return the picture's part of the window, [height, width, 3], and its upper left corner there."""
    settle(page)
    box = page.locator(".wv-stage").bounding_box()
    page.add_style_tag(content=".wv-tag, .wv-divider { visibility: hidden }")
    image = screenshot(page, folder, clip=box)
    page.locator("style").last.evaluate("(style) => style.remove()")
    return image, (box["x"], box["y"])


def pixels(page, folder, height=HEIGHT, width=WIDTH):
    """Return the colour at the middle of each pixel of pictures that are shown whole."""
    image, _ = drawn(page, folder)
    rows = ((np.arange(height) + 0.5) / height * image.shape[0]).astype(int)
    columns = ((np.arange(width) + 0.5) / width * image.shape[1]).astype(int)
    return image[np.ix_(rows, columns)]


def halves(left, right, column):
    return np.concatenate([left[:, :column], right[:, column:]], axis=1)


def run(page, call):
    return page.evaluate(f"{VIEWER}.{call}")


def focus_picture(page):
    page.get_by_role("application").focus()
