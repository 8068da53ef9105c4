"""How long a report takes to open in a browser, with as many pictures of 512x512 as it shows at most.

A study of four shipped scenes is rendered once, and its page opened in Debian's Chromium by Playwright (extra `test`):
until its first plot is drawn, the viewer shows its first pictures, and the page is read to its end. Each time is of a
new browser context, which has nothing of the page in its memory.
"""

import shutil
import time

import numpy as np
import timing
from playwright.sync_api import sync_playwright
from scipy import stats

import whitted
from whitted.reports import page

SPECIFICATION = {
    "title": "Forty pictures",
    "scenes": ["soft_shadows", "gloss", "depth_of_field", "interreflection"],
    "integrators": ["path", "distribution"],
    "effects": ["auto", "all"],
    "spp": [1, 2, 4],
    "replicates": 4,
    "width": 512,
    "reference": {"integrator": "path", "spp": 16, "replicates": 2},
}
TURNS = 15
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = ["--headless", "--no-sandbox", "--disable-gpu"]
VIEWER = "document.querySelector('.whitted-viewer')"
STEPS = {
    "the first plot is drawn": "() => document.querySelector('.js-plotly-plot .main-svg')",
    "the first pictures are shown": f"() => {VIEWER}?.viewer?.ready.then(() => true)",
    "all is read": "() => document.readyState === 'complete'",
}


def measure():
    folder = timing.FOLDER / "report_page"
    whitted.study(SPECIFICATION, folder)
    path = folder.with_suffix(".html")
    page.write(folder, path)
    program = next(filter(None, map(shutil.which, BROWSERS)))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=ARGUMENTS)
        turns = [_open(browser, path.resolve().as_uri()) for _ in range(TURNS)]
        browser.close()
    return {"bytes": path.stat().st_size, "pictures": turns[0].pop("pictures"), "seconds": turns}


def _open(browser, address):
    """Open the page; return the seconds until each step, and how many pictures the viewer offers."""
    context = browser.new_context()
    opened = context.new_page()
    begin = time.perf_counter()
    opened.goto(address, wait_until="commit")
    taken = {}
    for step, condition in STEPS.items():
        opened.wait_for_function(condition, polling="raf")
        taken[step] = time.perf_counter() - begin
    taken["pictures"] = opened.evaluate(f"{VIEWER}.viewer.entries.length")
    context.close()
    return taken


def show(found):
    print(f"{found['machine']}; {found['pictures']} pictures, {found['bytes'] / 1e6:.0f} MB; {TURNS} turns\n")
    rows = [("", "seconds, median", "95 %")]
    for step in STEPS:
        seconds = np.array([turn[step] for turn in found["seconds"]])
        interval = stats.bootstrap((seconds,), np.median, rng=0).confidence_interval
        rows.append((step, f"{np.median(seconds):.2f}", f"[{interval.low:.2f}, {interval.high:.2f}]"))
    timing.table(rows)


if __name__ == "__main__":
    timing.main("report_page", measure, show)
