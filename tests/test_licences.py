"""Licences of all installed packages: usable in any product, so no GPL, no AGPL."""

import re
from collections.abc import Iterator
from importlib.metadata import Distribution, distribution

import pytest
from packaging.requirements import Requirement

EXTRAS = ("benchmark", "cuda", "docs", "otel")
COPYLEFT = re.compile(r"(?<!L)\bA?GPL|(?<!Lesser )General Public License", re.IGNORECASE)


def runtime(name: str, extras: tuple[str, ...], seen: dict[str, Distribution]) -> None:
    """Collect a package and all it needs, by its name."""
    key = re.sub(r"[-_.]+", "-", name).lower()
    if key in seen:
        return
    seen[key] = distribution(name)
    for line in seen[key].requires or ():
        need = Requirement(line)
        if need.marker is None or any(need.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            runtime(need.name, tuple(need.extras), seen)


def stated(package: Distribution) -> Iterator[str]:
    """What a package says its licence is; of a text of many lines, the first."""
    for field in ("License-Expression", "License"):
        for text in package.metadata.get_all(field) or ():
            yield from text.strip().splitlines()[:1]
    yield from (line for line in package.metadata.get_all("Classifier") or () if line.startswith("License ::"))
    if package.read_text("licenses/LICENSE") or package.read_text("LICENSE"):
        yield "a file"


def test_no_package_that_the_service_needs_is_under_a_licence_that_spreads() -> None:
    packages: dict[str, Distribution] = {}
    runtime("meshmark", EXTRAS, packages)
    assert len(packages) > 60
    for name, package in packages.items():
        licences = list(stated(package))
        assert licences, f"{name} says nothing"
        assert not [text for text in licences if COPYLEFT.search(text)], (name, licences)


@pytest.mark.parametrize(
    ("text", "spreads"),
    [
        ("GPL-3.0-only", True),
        ("AGPL-3.0-or-later", True),
        ("License :: OSI Approved :: GNU General Public License v3 (GPLv3)", True),
        ("License :: OSI Approved :: GNU Affero General Public License v3", True),
        ("LGPL-3.0-only", False),
        ("License :: OSI Approved :: GNU Library or Lesser General Public License (LGPL)", False),
        ("MPL-2.0 AND MIT", False),
    ],
)
def test_licences_that_spread_are_told_from_those_that_do_not(text: str, spreads: bool) -> None:
    assert bool(COPYLEFT.search(text)) == spreads
