"""Manual and reference in a browser, which holds them to their security policies."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from playwright.sync_api import Browser, Page, expect

from service.routes.manual import manual_router
from tests.service.console.conftest import barriers
from tests.service.edge import Edge, edge_with
from tests.worker.waiting import PATIENCE


@pytest.fixture(scope="module")
def edge(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Edge]:
    """A server with the site as it is built of the pages there are."""
    with (
        patch("service.app.manual_router", lambda: manual_router(site)),
        edge_with(data_dir=tmp_path_factory.mktemp("manual")) as edge,
    ):
        yield edge


@contextmanager
def opened(browser: Browser, edge: Edge, path: str, **options: Any) -> Iterator[Page]:
    """A page; afterwards nothing was logged as an error and no other host was asked for anything."""
    home = f"http://127.0.0.1:{edge.port}"
    faults: list[str] = []
    page = browser.new_page(**options)
    page.set_default_timeout(PATIENCE * 1000)
    page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda asked: None if asked.url.startswith((home, "data:")) else faults.append(asked.url))
    page.goto(home + path)
    try:
        yield page
        assert faults == []
    finally:
        page.close()


def test_an_error_is_found_by_searching_for_its_words(browser: Browser, edge: Edge) -> None:
    with opened(browser, edge, "/docs/start/") as page:
        assert barriers(page) == []
        words = page.locator("input[role=combobox]")
        words.wait_for(state="attached")  # the dialog is there, closed
        page.keyboard.press("Control+k")
        words.fill("too many streams")
        page.locator("a[href*='errors/too_many_streams']").first.click()
        expect(page.get_by_role("heading", level=1)).to_contain_text("Too many streams", timeout=PATIENCE * 1000)
        assert "/docs/errors/too_many_streams/" in page.url


def test_a_request_is_tried_in_the_reference(browser: Browser, edge: Edge) -> None:
    with opened(browser, edge, "/reference") as page:
        operation = page.locator("#operations-watermarks-list_watermarks")
        operation.wait_for()
        # Buttons in buttons are the viewer's own.
        assert [found for found in barriers(page) if not found.startswith("nested-interactive")] == []
        operation.get_by_role("button").first.click()
        page.get_by_role("button", name="Authorize").first.click()
        page.get_by_label("auth-bearer-value").first.fill(edge.keys[0])
        page.locator(".auth-btn-wrapper .authorize").first.click()
        page.locator(".auth-btn-wrapper .btn-done").first.click()
        operation.get_by_role("button", name="Try it out").click()
        operation.get_by_role("button", name="Execute").click()
        expect(operation.locator(".live-responses-table .response-col_status").nth(1)).to_have_text(
            "200", timeout=PATIENCE * 1000
        )


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_small_words_of_the_reference_are_as_dark_or_as_light_as_wcag_asks(
    scheme: str, browser: Browser, edge: Edge
) -> None:
    with opened(browser, edge, "/reference", color_scheme=scheme) as page:
        operation = page.locator("#operations-watermarks-create_watermark")
        operation.get_by_role("button").first.click()
        operation.get_by_role("button", name="Try it out").click()
        expect(operation.locator(".response-col_status").filter(has_text="202")).to_be_visible()
        page.get_by_role("button", name="Schemas").click()
        page.get_by_role("button", name="Expand all").nth(1).click()
        expect(page.locator(".json-schema-2020-12-property").first).to_be_visible()
        assert [found for found in barriers(page) if found.startswith("color-contrast")] == []
