"""Pages in a real browser, and all that they say and ask for: `pytest_plugins = ["browser"]` brings the fixtures.

Playwright drives the system's Chromium, since its own can't be had everywhere; without one the tests are skipped.
"""

import shutil
from dataclasses import dataclass, field

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--force-color-profile=srgb",
]


@dataclass
class Record:
    """What a page has written to the console, its errors, and what it has asked for."""

    console: list = field(default_factory=list)
    errors: list = field(default_factory=list)
    requests: list = field(default_factory=list)

    def watch(self, page):
        page.on("console", lambda message: self.console.append(message.text))
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))


@pytest.fixture(scope="session")
def chromium():
    sync_api = pytest.importorskip("playwright.sync_api", reason="no Playwright")
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is on the path")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def record():
    return Record()


@pytest.fixture
def visit(chromium):
    """Open a file in a browser window; each must have said nothing and asked for nothing else in the end.

    Returns:
        A function of a path and of options of Playwright's ``new_context``, such as ``color_scheme``; it returns the
        page.
    """
    opened = []

    def visit(path, **options):
        context = chromium.new_context(**{"reduced_motion": "reduce"} | options)
        page, record = context.new_page(), Record()
        record.watch(page)
        opened.append((context, path.as_uri(), record))
        page.goto(path.as_uri())
        return page

    yield visit
    for context, address, record in opened:
        context.close()
        assert record == Record(requests=[address])
