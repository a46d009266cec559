"""Every link in README and manual leads somewhere, and every path that they name is there."""

import re
from functools import cache
from pathlib import Path

import pytest

from tests.manual import MANUAL, README, ROOT

PAGES = [README, *sorted(MANUAL.glob("*.md"))]
CODE = re.compile(r"^ {0,3}```.*?^ {0,3}```$|^ {4}.*?$|`[^`\n]*`", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")
# A path of the repository in the text, with no placeholder in it.
PATH = re.compile(r"(?:core|service|worker|docker|tests|\.github)/[\w./-]*\w|(?:pyproject|openapi)\.\w+")

every_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


@cache
def headings(page: Path) -> list[tuple[int, str]]:
    """Level and text of each heading."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    return [(len(marks), words) for marks, words in re.findall(r"^(#+) (.+)$", text, re.MULTILINE)]


def anchor(heading: str) -> str:
    """The anchor of a heading, as GitHub and Python-Markdown make it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def links(page: Path) -> list[str]:
    found = LINK.findall(CODE.sub("", page.read_text()))
    return [link for link in found if not re.match(r"\w+:", link)]


@every_page
def test_every_link_leads_to_a_file_and_to_a_heading_in_it(page: Path) -> None:
    for link in links(page):
        name, _, fragment = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.is_file(), link
        if fragment:
            assert fragment in [anchor(words) for _, words in headings(target)], link


@pytest.mark.parametrize("page", PAGES[1:], ids=lambda page: page.name)
def test_the_manual_links_nothing_that_is_not_served_with_it(page: Path) -> None:
    assert [
        link for link in links(page) if not (MANUAL / link.partition("#")[0]).resolve().is_relative_to(MANUAL)
    ] == []


@every_page
def test_a_page_has_one_title_at_its_beginning_and_no_heading_twice(page: Path) -> None:
    assert page.read_text().startswith("# ")
    assert [level for level, _ in headings(page)].count(1) == 1
    anchors = [anchor(words) for _, words in headings(page)]
    assert len(set(anchors)) == len(anchors)


@every_page
def test_every_path_of_the_repository_that_is_named_is_there(page: Path) -> None:
    spans = re.findall(r"`([^`\n]+)`", page.read_text())
    named = [span for span in spans if PATH.fullmatch(span)]
    missing = [path for path in named if not (ROOT / path).exists() and path != "docker/secrets"]
    assert not [path for path in missing if "NAME" not in path]


@pytest.mark.parametrize("start", [README, MANUAL / "index.md"], ids=lambda page: page.name)
def test_every_page_of_the_manual_is_linked_from_the_start(start: Path) -> None:
    linked = {(start.parent / link.partition("#")[0]).resolve() for link in links(start)}
    assert {page for page in PAGES if page not in (README, MANUAL / "index.md")} <= linked
