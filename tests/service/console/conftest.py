"""A browser, and pages of it that fail their test where anything is wrong that nobody would see."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from tests.worker.waiting import PATIENCE

SOFTWARE_GL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
AXE = Path(__file__).parents[2] / "node_modules" / "axe-core" / "axe.min.js"
FRAMES = "(async () => { for (let n = 0; n < 5; n++) await new Promise(requestAnimationFrame); })()"  # are drawn
SIZE = {"width": 900, "height": 640}  # small: a processor draws it


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        pytest.fail("chromium is not installed: apt-get install chromium", pytrace=False)
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=program, args=SOFTWARE_GL)
        yield started
        started.close()


@contextmanager
def opened(browser: Browser, url: str, refused: bool = False, **options: Any) -> Iterator[Page]:
    """The console in a fresh browser.

    Afterwards: no error was logged (of requests, only where some are to be ``refused``), no policy was violated, and no
    other host was asked for anything.
    """
    faults: list[str] = []
    home = url.partition("#")[0]
    context = browser.new_context(**{"viewport": SIZE, "locale": "en-GB", "reduced_motion": "reduce", **options})
    context.set_default_timeout(PATIENCE * 1000)
    page = context.new_page()

    def logged(kind: str, text: str) -> None:
        expected = refused and text.startswith("Failed to load resource: the server responded with a status of 4")
        if kind == "error" and not expected:
            faults.append(text)

    def asked(address: str) -> None:
        if not address.startswith((home, "blob:")):
            faults.append(f"asked for {address}")

    page.on("console", lambda message: logged(message.type, message.text))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda request: asked(request.url))
    # Playwright catches file choosers from the moment on in which somebody listens: soon after would be too late.
    page.on("filechooser", lambda _: None)
    page.goto(url)
    try:
        yield page
        assert faults == []
    finally:
        context.close()


def keep(page: Page, name: str) -> None:
    """A picture of the page as it stands, in the folder that the variable SCREENSHOTS names, if it does."""
    if folder := os.environ.get("SCREENSHOTS"):
        page.evaluate(FRAMES)
        page.screenshot(path=Path(folder) / f"{name}.png", animations="disabled")


def barriers(page: Page) -> list[str]:
    """Serious findings of axe on the page as it stands."""
    page.evaluate(AXE.read_text())
    found = page.evaluate("axe.run(document, {resultTypes: ['violations']})")
    return [
        f"{each['id']}: {each['nodes'][0]['html'][:200]} ({each['nodes'][0]['failureSummary'][:200]})"
        for each in found["violations"]
        if each["impact"] in ("serious", "critical")
    ]
