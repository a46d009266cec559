"""The evidence page shows a whole verification, and nothing that a suspect file says does anything in it."""

import base64
from datetime import UTC, datetime
from html.parser import HTMLParser
from typing import Any

import pytest

from core.verify.evidence import MOST_LETTERS, MOST_ROWS, evidence_page
from core.verify.report import VerificationReport

PICTURE = b"\x89PNG of a mark"
EVIL = '<script>alert("1")</script><img src=x onerror=alert(1)>\'"&'
MOMENT = datetime(2030, 1, 2, 3, 4, 5, tzinfo=UTC)


def report(**changed: Any) -> dict[str, Any]:
    mark = {
        "text": "ORDER-471I",
        "known": "ORDER-4711",
        "likeness": 0.9,
        "confidence": 0.87,
        "votes": 3,
        "pictures": ["ordinary", "relief"],
        "center": [0.125, 2, 3],
        "right": [1, 0, 0],
        "normal": [0, 0, 1],
        "length": 4.5,
    }
    label = dict.fromkeys(
        ("source_type", "title", "rights", "identifier", "created", "modified", "system", "system_version", "copyright")
    )
    facts = {
        "file": {"sha256": "ab" * 32, "bytes": 12345, "format": "glb"},
        "engine": {"version": "9.8.7", "device": "cpu"},
        "texts": ["ORDER-4711", "ORDER-4712"],
        "found": ["ORDER-4711"],
        "marks": [mark],
        "label": label | {"creator": "Somebody", "aigc": [{"fields": {"Label": "1"}, "text": None}]},
        "credentials": {"state": "tampered", "codes": ["assertion.dataHash.mismatch"], "issuer": "Somebody else"},
        "warnings": [{"code": "small", "message": "It is small.", "remedy": "Look."}],
        "timings": {"all": 1.25},
    }
    return VerificationReport.model_validate(facts | changed).model_dump(mode="json")


class Page(HTMLParser):
    """The elements of a page with their attributes, and its text."""

    def __init__(self, page: bytes) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(page.decode())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data

    def attributes(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


def page(filename: str = "cow.glb", pictures: tuple[bytes, ...] = (PICTURE,), **changed: Any) -> Page:
    return Page(evidence_page(report(**changed), pictures, filename, MOMENT))


def test_the_page_tells_all_that_was_found() -> None:
    shown = page()
    file = ("cow.glb", "ab" * 32, "12,345 bytes", "glb", "9.8.7", "2030-01-02 03:04:05 UTC", "1.2 s")
    marks = ("1 of 2 texts found", "not found", "ORDER-471I", "0.90 of 1", "3 (ordinary, relief)", "0.125, 2, 3", "4.5")
    rest = ("creator", "Somebody", "AIGC", "Label", "It is small. Look.", "not signed", "--text=ORDER-4711")
    assert [said for said in (*file, *marks, *rest) if said not in shown.text] == []
    [picture] = shown.attributes("img")
    assert picture["src"] == "data:image/png;base64," + base64.b64encode(PICTURE).decode()


def test_a_page_needs_no_network_and_runs_nothing() -> None:
    shown = page()
    [policy] = [found["content"] for found in shown.attributes("meta") if "http-equiv" in found]
    assert policy == "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    assert {tag for tag, _ in shown.elements}.isdisjoint({"script", "link", "iframe", "a", "form", "object"})
    assert all(str(found["src"]).startswith("data:") for found in shown.attributes("img"))


def evil() -> dict[str, Any]:
    usual = report()
    return {
        "texts": [EVIL],
        "found": [EVIL],
        "marks": [usual["marks"][0] | {"text": EVIL, "known": EVIL}],
        "label": usual["label"] | {"creator": EVIL, "aigc": [{"fields": {EVIL: EVIL}, "text": None}]},
        "credentials": usual["credentials"] | {"issuer": EVIL, "name": EVIL, "actions": [EVIL], "marks": [EVIL]},
        "warnings": [{"code": EVIL, "message": EVIL, "remedy": EVIL}],
    }


def test_markup_of_the_file_is_shown_as_text() -> None:
    shown, plain = page(EVIL, **evil()), page()
    assert {tag for tag, _ in shown.elements} == {tag for tag, _ in plain.elements}
    assert {name for _, found in shown.elements for name in found} == {
        name for _, found in plain.elements for name in found
    }
    assert shown.text.count(EVIL) == 3 + 1 + 2 + 3 + 4 + 3  # name, text asked for, mark, metadata, credentials, warning


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("cow\u202eblg.exe", "cow[U+202E]blg.exe"),
        ("a\x00b\x1bc\x85d\u200be\ud800f", "a[U+0000]b[U+001B]c[U+0085]d[U+200B]e[U+D800]f"),
        ("two\nlines", "two\nlines"),
        ("क्\u200dष", "क्\u200dष"),
    ],
)
def test_characters_that_are_not_seen_are_told_by_number(said: str, shown: str) -> None:
    usual = report()
    usual["label"]["creator"] = said
    read = evidence_page(usual, [PICTURE], said).decode()
    assert read.count(f"<bdi>{shown}</bdi>") == 3


def test_a_page_stays_short_whatever_the_file_says() -> None:
    usual, pictures = report(), [PICTURE]
    usual["label"]["creator"] = "é" * 10_000_000
    usual["label"]["aigc"] = [{"fields": {str(number): "x" for number in range(100_000)}, "text": None}]
    read = evidence_page(usual, pictures, "cow.glb").decode()
    assert len(read) < 100_000
    assert "é" * MOST_LETTERS + "… (10,000,000 characters in all)" in read
    assert f"and {100_001 - MOST_ROWS:,} more" in read


def test_it_says_of_credentials_that_they_are_not_the_files() -> None:
    shown = page()
    assert "tampered: they are not those of this file, or were changed" in shown.text
    assert "assertion.dataHash.mismatch" in shown.text
    assert "Content Credentials" not in page(credentials=None).text
    marked = {"state": "valid", "codes": [], "marks": ["SAMPLE", "AI", "SAMPLE"]}
    assert "SAMPLE (2 times), AI" in page(credentials=marked).text


def test_the_comparison_with_an_original_is_shown_with_its_reliefs() -> None:
    mark = {"index": 7, "text": EVIL, "height": 0.0123, "surface": 1.0}
    reported = {"present": True, "correlation": 0.98, "standing_out": 0.4}
    original: dict[str, Any] = {
        "file": {"sha256": "cd" * 32, "bytes": 1, "format": "glb"},
        "is_asset": True,
        "is_result": False,
        "scale": 2.5,
        "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "translation": [0, 0, 0],
        "residual": 0.0012,
        "covered": 0.5,
        "marks": [mark | reported, mark | {"present": False, "correlation": None, "standing_out": 0.0}],
    }
    reliefs = (b"red", b"blue")
    shown = Page(evidence_page(report(original=original), [PICTURE], "cow.glb", MOMENT, reliefs))
    said = (
        "cd" * 32,
        "0.12 %",
        "50 % of the original",
        "1 of 2 are there",
        "this very file",
        EVIL,
        "0.98 of 1",
        "0.0123",
        "Relief of the job's mark 7",
    )
    assert [one for one in (*said, "--original ORIGINAL --report-of REPORT") if one not in shown.text] == []
    assert [str(found["src"]).split(",")[1] for found in shown.attributes("img")[1:]] == [
        base64.b64encode(relief).decode() for relief in reliefs
    ]
    original |= {"is_asset": None, "is_result": None, "marks": [mark]}
    unasked = Page(evidence_page(report(original=original), [PICTURE], "cow.glb", MOMENT, reliefs[:1]))
    assert "Relief of mark 8" in unasked.text  # marks that were read are counted from 1 above
    assert "are there" not in unasked.text
    assert "--report-of" not in unasked.text


def test_nothing_found_and_nothing_asked_is_told_too() -> None:
    nothing = page("cow.glb", (), texts=[], found=None, marks=[], label=None, warnings=[])
    assert "No text was asked for; 0 marks read." in nothing.text
    assert "None was read." in nothing.text
    assert "They say nothing." in nothing.text
    assert "0 of 1 text found" in page("cow.glb", (), texts=["A"], found=[], marks=[]).text


def test_writing_in_a_picture_is_placed_by_its_pixel() -> None:
    place = {"center": None, "right": None, "normal": None, "length": None, "pixel": [12.0, 34.5]}
    assert "pixel 12, 34.5" in page(marks=[report()["marks"][0] | place]).text
