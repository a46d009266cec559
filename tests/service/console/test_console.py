"""The console as people use it: a browser, the real service, a real worker."""

import base64
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, FilePayload, Locator, Page, expect

from core.gltf.document import Document
from tests.core.formats.samples import OFF
from tests.core.gltf.compressed import draco
from tests.service.console.conftest import barriers, keep, opened
from tests.service.harness import API_COMMAND, Service
from tests.worker.waiting import PATIENCE

SPOT = Path(__file__).parents[2] / "data" / "spot.glb"
NO_FACES = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
DROP = """(content) => {
  const file = new File([Uint8Array.from(atob(content), (c) => c.charCodeAt(0))], "cow.glb");
  const data = new DataTransfer();
  data.items.add(file);
  for (const type of ["dragenter", "dragover", "drop"])
    document.body.dispatchEvent(new DragEvent(type, { dataTransfer: data, bubbles: true, cancelable: true }));
}"""

expect.set_options(timeout=PATIENCE * 1000)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("console"), log_level="WARNING")
    with service.running([sys.executable, "-m", "service"]):
        yield service


def choose_quick_settings(page: Page) -> None:
    """Two marks, which are explained."""
    page.get_by_text("Shape and number", exact=True).click()
    page.get_by_label("Most marks").fill("2")
    page.get_by_text("More", exact=True).click()
    page.get_by_label("Explain the places").select_option("true")


def tab_to(page: Page, target: Locator) -> None:
    """Press Tab until something has the focus."""
    for _ in range(80):
        page.keyboard.press("Tab")
        if target.evaluate("(element) => element === document.activeElement"):
            return
    pytest.fail(f"Tab does not lead to {target}")


def test_a_file_is_dropped_looked_at_watermarked_compared_and_downloaded(browser: Browser, service: Service) -> None:
    with opened(browser, service.url + "/") as page:
        sent: list[str] = []
        page.on("request", lambda request: sent.append(request.method))
        expect(page.get_by_role("button", name="Choose a file first")).to_be_disabled()
        keep(page, "start")
        page.evaluate(DROP, base64.b64encode(SPOT.read_bytes()).decode())
        expect(page.locator("[data-shown=before]")).to_be_attached()
        expect(page.get_by_text("5,856")).to_be_visible()
        assert "POST" not in sent, "nothing has left the browser"

        page.get_by_label("Text", exact=True).fill("SAMPLE")
        page.get_by_role("button", name="Draw a box").click()
        page.get_by_label("Upper Y").fill("0.123")
        page.get_by_label("Upper Y").press("Enter")
        keep(page, "form-with-a-box")
        page.get_by_role("tab", name="API").click()
        keep(page, "api")
        expect(page.locator("pre")).to_contain_text(re.compile(r"-F 'file=@cow.glb'.*keep_out.*0\.123", re.DOTALL))
        assert barriers(page) == []
        page.get_by_role("tab", name="Settings").click()
        page.get_by_role("button", name="Remove box").click()
        choose_quick_settings(page)
        assert barriers(page) == []
        page.get_by_role("button", name="Watermark", exact=True).click()

        expect(page.locator("[data-test=said]")).to_contain_text("2 marks stand on the model: “SAMPLE”.")
        expect(page.locator("[data-shown='before after']")).to_be_attached()
        divider = page.get_by_role("slider")
        keep(page, "result-slider")
        divider.press("ArrowLeft")
        expect(divider).to_have_attribute("aria-valuenow", "45")
        mark = page.get_by_role("button", name="Mark 1: SAMPLE")
        mark.press("Enter")
        expect(mark).to_have_class(re.compile(r"\bon\b"))
        page.get_by_role("button", name="Side by side").click()
        keep(page, "result-side-by-side")
        assert barriers(page) == []
        with page.expect_download() as download:
            page.get_by_role("button", name="Download the model").click()
        job = page.url.rpartition("/")[2]
        model = service.client.get(f"/v1/watermarks/{job}/model").content
        assert Path(download.value.path()).read_bytes() == model
        assert download.value.suggested_filename == "cow.watermarked.glb"
        page.get_by_role("tab", name="Figures").click()
        expect(page.get_by_role("img", name="Map of the directions that 2 marks face")).to_be_visible()
        assert barriers(page) == []
        view = page.get_by_role("button", name="View 1:")
        expect(view.locator("img")).to_have_attribute("src", re.compile("^blob:"))
        view.press("Enter")
        keep(page, "figures")
        assert barriers(page) == []
        page.get_by_role("tab", name="Why").click()
        expect(page.get_by_text("2 marks were chosen among")).to_be_visible()
        page.get_by_label("Candidates, before fine-tuning").check()
        keep(page, "why")
        page.get_by_text("Mark 2:").click()
        expect(page.locator("details[open]").get_by_text("Adds, seen from all around")).to_be_visible()
        assert barriers(page) == []

        page.get_by_role("tab", name="Copies").click()
        expect(page.get_by_text("There are no copies yet.")).to_be_visible()
        page.get_by_label("Texts of copies").fill("ORDER-1\n\nORDER-2")
        page.get_by_role("button", name="Make 2 copies").click()
        with page.expect_download() as download:
            page.get_by_role("button", name="Download the copy ORDER-2").click()
        assert download.value.suggested_filename == "cow-ORDER-2.watermarked.glb"
        keep(page, "copies")
        assert barriers(page) == []

        page.get_by_role("link", name="Jobs", exact=True).click()
        expect(page.get_by_role("link", name="cow.glb").filter(has_text="SAMPLE").locator("img")).to_be_attached()
        keep(page, "jobs")
        assert barriers(page) == []
        page.get_by_role("link", name="cow.glb").filter(has_text="SAMPLE").click()
        expect(page.get_by_role("button", name="Mark 2: SAMPLE")).to_be_attached()
        assert page.url.endswith(f"#/jobs/{job}")


def test_what_is_wrong_is_said_at_once_with_the_remedy(browser: Browser, service: Service) -> None:
    with opened(browser, service.url + "/", refused=True) as page:
        points = FilePayload(name="points.obj", mimeType="", buffer=NO_FACES)
        page.locator("#asset").set_input_files([points])
        expect(page.get_by_text("There are no triangles in this file.")).to_be_visible()
        page.get_by_text("Shape and number", exact=True).click()
        width = page.get_by_label("Width of the text")
        width.fill("99")
        expect(page.get_by_text("Write a number from 0.5 to 30.")).to_be_visible()
        expect(width).to_have_attribute("aria-invalid", "true")
        send = page.get_by_role("button", name="Watermark", exact=True)
        send.click()
        expect(width).to_be_focused()
        width.fill("")
        send.click()
        expect(page.get_by_text("Write a text, or choose a logo or a label.")).to_be_visible()
        page.get_by_label("Text", exact=True).fill("HI")
        send.click()
        problem = page.get_by_role("alert")
        expect(problem).to_contain_text("no_faces")
        expect(problem).to_contain_text("What to do:")
        keep(page, "problem")
        assert barriers(page) == []
        page.goto(service.url + "/#/jobs/none")
        expect(page.get_by_role("alert")).to_contain_text("not_found")


def test_what_the_browser_cannot_show_is_shown_by_the_service_once_it_may_be_sent(
    browser: Browser, service: Service
) -> None:
    with opened(browser, service.url + "/", color_scheme="dark") as page:
        sent: list[str] = []
        page.on("request", lambda request: sent.append(f"{request.method} {request.url}"))
        compressed = draco(Document.from_glb(SPOT.read_bytes())).to_glb()
        page.locator("#asset").set_input_files([FilePayload(name="small.glb", mimeType="", buffer=compressed)])
        expect(page.get_by_text("compressed with Draco")).to_be_visible()
        keep(page, "not-shown")
        assert barriers(page) == []
        assert not any(line.startswith("POST") for line in sent), "nothing has left the browser"
        with page.expect_response(lambda response: response.request.method == "DELETE"):
            page.get_by_role("button", name="Show it (sends the file to the service)").click()
        expect(page.locator("[data-shown=before]")).to_be_attached()
        assert page.get_by_label("Text", exact=True).is_visible()
        expect(page.get_by_role("button", name="Draw a box")).to_be_enabled()
        assert [line.partition("/v1/")[2] for line in sent if line.startswith("POST")] == ["conversions"]

        # One that is sent unseen stands beside its result.
        page.locator("#other").set_input_files([FilePayload(name="cube.off", mimeType="", buffer=OFF)])
        expect(page.get_by_text("OFF files are not shown in the browser.")).to_be_visible()
        page.get_by_label("Text", exact=True).fill("HI")
        page.get_by_text("Shape and number", exact=True).click()
        page.get_by_label("Most marks").fill("1")
        page.get_by_text("More", exact=True).click()
        page.get_by_label("Measurement").select_option("geometry")
        page.get_by_role("button", name="Watermark", exact=True).click()
        expect(page.locator("[data-shown='before after']")).to_be_attached()
        expect(page.locator("[data-test=said]")).to_be_visible()
        page.get_by_role("button", name="Side by side").click()
        keep(page, "dark-result")
        assert barriers(page) == []


def test_all_can_be_done_by_keyboard(browser: Browser, service: Service) -> None:
    with opened(browser, service.url + "/") as page:
        # Heard of from the beginning: the browser takes a moment to begin telling, and a dialog before that is lost.
        page.on("filechooser", lambda dialog: dialog.set_files(SPOT))
        page.keyboard.press("Tab")
        expect(page.get_by_role("link", name="Skip to the content")).to_be_focused()
        page.keyboard.press("Enter")
        expect(page.get_by_role("main")).to_be_focused()
        tab_to(page, page.locator("#asset"))
        page.keyboard.press("Enter")
        expect(page.locator("[data-shown=before]")).to_be_attached()
        tab_to(page, page.get_by_role("tab", name="Settings"))
        page.keyboard.press("ArrowRight")
        expect(page.get_by_role("tab", name="API")).to_have_attribute("aria-selected", "true")
        page.keyboard.press("ArrowLeft")
        tab_to(page, page.get_by_label("Text", exact=True))
        page.keyboard.type("SAMPLE")
        tab_to(page, page.get_by_role("button", name="Draw a box"))
        page.keyboard.press("Enter")
        tab_to(page, page.get_by_label("Lower X"))
        page.keyboard.press("Control+a")
        page.keyboard.type("-9")
        tab_to(page, page.get_by_role("button", name="Watermark", exact=True))
        page.keyboard.press("Enter")
        tab_to(page, page.get_by_role("button", name="Cancel the job"))
        page.keyboard.press("Enter")
        expect(page.get_by_role("tab", name="Settings")).to_be_visible()
        listed = service.client.get("/v1/watermarks", params={"limit": 1}).json()["items"]
        assert [job["state"] for job in listed] == ["canceled"]


def test_a_picture_is_verified_on_a_phone_in_the_dark_in_chinese(browser: Browser, service: Service) -> None:
    phone: dict[str, Any] = {
        "viewport": {"width": 390, "height": 780},
        "locale": "zh-CN",
        "color_scheme": "dark",
        "has_touch": True,
    }
    with opened(browser, service.url + "/", **phone) as page:
        assert page.evaluate("document.documentElement.lang") == "zh-Hans"
        page.get_by_role("link", name="核验").click()
        expect(page.get_by_role("heading", name="将可疑文件或其图片拖到这里")).to_be_visible()
        page.locator("#asset").set_input_files(SPOT.with_name("spot-watermarked.png"))
        page.get_by_label("要查找的文字").fill("watermark")
        keep(page, "phone-verify")
        assert barriers(page) == []
        page.get_by_role("button", name="开始核验").click()
        expect(page.locator("[data-test=read]")).to_contain_text("“watermark”")
        expect(page.get_by_role("link", name="打开证据页")).to_be_visible()
        keep(page, "phone-verified")
        assert barriers(page) == []
        for link in ("添加水印", "任务"):
            page.get_by_role("link", name=link).first.click()
            expect(page.get_by_role("link", name=link).first).to_have_attribute("aria-current", "page")
            assert page.evaluate("document.documentElement.scrollWidth") == 390, link
            keep(page, f"phone-{page.url.partition('#/')[2] or 'start'}")
            assert barriers(page) == []
        ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert max(map(int, re.findall(r"\d+", ground)[:3])) < 40, ground
        page.get_by_role("button", name="English").click()
        expect(page.get_by_role("heading", name="Jobs")).to_be_visible()


def test_a_key_is_asked_for_and_kept_in_this_tab_alone(browser: Browser, tmp_path: Path) -> None:
    service = Service(tmp_path, auth="keys", log_level="WARNING")
    with service.running(API_COMMAND):
        create = [sys.executable, "-m", "service", "keys", "create", "--tenant", "acme", "--name", "console"]
        made = subprocess.run(create, env=os.environ | service.environment, check=True, capture_output=True, text=True)
        with opened(browser, service.url + "/#/jobs", refused=True) as page:
            dialog = page.get_by_role("dialog")
            expect(dialog).to_be_visible()
            keep(page, "key")
            assert barriers(page) == []
            page.get_by_label("Key", exact=True).fill(made.stdout.strip())
            page.keyboard.press("Enter")
            expect(page.get_by_text("There are no jobs here.")).to_be_visible()
            assert "mm_" in str(page.evaluate("JSON.stringify(sessionStorage)"))
            assert "mm_" not in str(page.evaluate("JSON.stringify(localStorage) + document.cookie"))
