"""The manual as a site: what it has, that it asks no other host for anything, and that a strict policy holds for it."""

import json
import re
import tomllib
from base64 import b64encode
from functools import cache
from hashlib import sha256
from html.parser import HTMLParser
from pathlib import Path

import pytest

from service.errors import CODES
from service.manual import catalogue
from service.manual.build import CONFIG, BuildError, build, groups, llms, write_types
from service.manual.catalogue import error_pages
from service.routes.manual import SEARCH_STYLE
from service.static_file import MEDIA_TYPES
from tests.manual import MANUAL, ROOT

PROJECT = tomllib.loads(CONFIG.read_text())["project"]
WRITTEN = {path.stem for path in MANUAL.glob("*.md")}
LOADING = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src", "audio": "src"}


class Page(HTMLParser):
    """Tags of a page with their attributes, and what stands in its scripts that run and its styles."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.inline: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        tag, attributes = self.tags[-1] if self.tags else ("", {})
        if tag == "style" or (tag == "script" and attributes.get("type") != "application/json"):
            self.inline.append(data.strip())

    def loaded(self) -> list[str]:
        """Addresses that a browser asks for by itself."""
        named = [attributes.get(LOADING[tag]) for tag, attributes in self.tags if tag in LOADING]
        linked = [
            attributes.get("href")
            for tag, attributes in self.tags
            if tag == "link" and attributes.get("rel") in ("stylesheet", "icon", "preload", "preconnect", "manifest")
        ]
        return [address for address in (*named, *linked) if address]


@cache
def pages(site: Path) -> dict[str, Page]:
    return {path.relative_to(site).as_posix(): Page(path.read_text()) for path in site.rglob("*.html")}


def test_the_site_has_the_pages_of_the_manual_and_one_for_each_error_and_no_other(site: Path) -> None:
    expected = {"index.html", *(f"{name}/index.html" for name in WRITTEN - {"index"})}
    expected |= {f"errors/{code}/index.html" for code in CODES}
    assert pages(site).keys() == expected


def test_every_file_has_a_media_type(site: Path) -> None:
    assert {path.suffix for path in site.rglob("*.*")} <= MEDIA_TYPES.keys()


def test_every_page_is_there_as_markdown_too_and_says_so(site: Path) -> None:
    for name, page in pages(site).items():
        (twin,) = [tag["href"] for _, tag in page.tags if tag.get("type") == "text/markdown"]
        assert twin is not None
        source = (site / name).parent / twin
        assert source.read_text().startswith("# "), name
        if (written := MANUAL / source.name).exists() and source.stem != "errors":
            assert source.read_text() == written.read_text()


def test_every_page_of_the_manual_is_in_the_navigation_once_and_in_llms_txt(site: Path) -> None:
    listed = [file for found in groups().values() for _, file, _ in found]
    assert sorted(listed) == sorted(f"{name}.md" for name in WRITTEN - {"index"})
    text = (site / "llms.txt").read_text()
    assert text == llms(PROJECT)
    assert re.findall(r"\]\(/docs/([\w-]+\.md)\): \S", text) == listed
    page = pages(site)["start/index.html"]
    navigated = {tag.get("href") for _, tag in page.tags if "md-nav__link" in (tag.get("class") or "")}
    assert {f"../{name.removesuffix('.md')}/" for name in listed} - navigated <= {"../start/"}
    assert "/reference" in navigated


def test_nothing_is_loaded_from_another_host(site: Path) -> None:
    for name, page in pages(site).items():
        for address in page.loaded():
            assert re.match(r"\w*:|//", address) is None, (name, address)
            assert ((site / name).parent / address).resolve().is_file(), (name, address)
    for style in site.rglob("*.css"):
        for address in re.findall(r"url\(\s*[\"']?([^)\"']+)|@import\s+[\"']([^\"']+)", style.read_text()):
            assert "".join(address).startswith("data:"), style.name


def test_no_page_has_a_script_or_a_style_in_it(site: Path) -> None:
    for name, page in pages(site).items():
        assert not any(page.inline), name
        assert not [tag for tag in page.tags if any(key == "style" or key.startswith("on") for key in tag[1])], name


def test_the_one_style_that_is_written_into_pages_is_that_which_the_policy_names(site: Path) -> None:
    (bundle,) = (site / "assets" / "javascripts").glob("bundle.*.js")
    text = bundle.read_text()
    variable = re.search(r'"style",\{\},(\w+)\.toString\(\)', text)
    assert variable is not None
    style = re.search(rf"\b{variable[1]}='([^'\\]*)'", text)
    assert style is not None
    assert b64encode(sha256(style[1].encode()).digest()).decode() == SEARCH_STYLE.removeprefix("sha256-")


def test_links_between_pages_lead_to_pages_and_their_headings(site: Path) -> None:
    there = pages(site)
    names = {
        name: {str(value) for _, tag in page.tags for key, value in tag.items() if key in ("id", "name")}
        for name, page in there.items()
    }
    for name, page in there.items():
        for tag, attributes in page.tags:
            link = attributes.get("href")
            if tag != "a" or not link or re.match(r"\w+:|/", link):
                continue
            path, _, fragment = link.partition("#")
            target = ((site / name).parent / path).resolve() if path else site.resolve() / name
            if target.is_dir():
                target /= "index.html"
            assert target.is_file(), (name, link)
            if fragment and target.suffix == ".html":
                assert fragment in names[target.relative_to(site.resolve()).as_posix()], (name, link)


def test_the_types_of_the_api_for_typescript_lie_beside_the_pages(site: Path) -> None:
    text = (site / "meshmark.d.ts").read_text()
    assert '"/v1/watermarks/{job_id}/model": {' in text
    assert "export type Parameters = " in text
    assert "file?: Blob;" in text


@pytest.mark.parametrize("missing", ["packages", "Node.js"])
def test_types_that_cannot_be_written_stop_the_build_with_what_to_do(
    missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if missing == "packages":
        monkeypatch.setattr("service.manual.build.LIBRARIES", tmp_path / "none")
    else:
        monkeypatch.setenv("PATH", str(tmp_path))
        monkeypatch.setattr("service.manual.build.find_spec", lambda _: None)
    with pytest.raises(BuildError, match="Run `make install`"):
        write_types(tmp_path / "meshmark.d.ts")


def test_a_fault_in_the_openapi_document_stops_the_build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document = tmp_path / "openapi.yaml"
    document.write_text("openapi: 3.1.0\npaths: {/a: {$ref: '#/nowhere'}}\n")
    monkeypatch.setattr("service.manual.build.OPENAPI", document)
    with pytest.raises(BuildError, match=r"(?s)not written\. .*Can't resolve \$ref at #/paths/~1a$"):
        write_types(tmp_path / "meshmark.d.ts")


def test_search_finds_parameters_errors_and_settings(site: Path) -> None:
    items = json.loads((site / "search.json").read_text())["items"]
    text = {item["location"]: f"{item['title']} {item['text']}" for item in items}
    assert "Truncated file" in text["errors/truncated_file/"]
    for words in ("keep_out", "MESHMARK_JOB_TIME_LIMIT", "label_too_small"):
        assert any(words in each for each in text.values()), words


def test_the_page_of_an_error_says_what_it_means_what_to_do_and_which_requests_answer_with_it(site: Path) -> None:
    text = (site / "errors" / "different_model.md").read_text()
    assert text.startswith("# Different model\n")
    assert "422" in text
    assert "does not fit the original" in text
    assert "[verification](../verification.md#against-an-original)" in text
    text = (site / "errors" / "idempotency_key_reused.md").read_text()
    assert "- `POST /v1/watermarks`\n" in text
    assert "GET" not in text


def test_a_code_without_a_row_in_the_manual_and_a_row_without_a_code_stop_the_build() -> None:
    text = (MANUAL / "errors.md").read_text()
    for wrong in (text.replace("`no_faces`", "`no_face`"), text.replace("| `no_faces`", "")):
        with pytest.raises(ValueError, match="no_faces"):
            error_pages(wrong, ROOT / "openapi.yaml")


def test_a_fault_in_a_page_stops_the_build_and_leaves_the_site_there_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "kept").touch()
    monkeypatch.setattr("service.manual.build.with_links", lambda text: text + "\n[lost](nowhere.md)\n")
    with pytest.raises(BuildError, match=r"nowhere\.md"):
        build(tmp_path)
    assert (tmp_path / "kept").exists()


def test_sentences_of_the_catalogue_begin_and_end_as_such() -> None:
    assert catalogue._sentence("see [A](api.md#b), `x`") == "See [A](../api.md#b), `x`."
