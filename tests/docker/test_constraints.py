"""Versions that are pinned run on every Python that the project promises."""

import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[2]
PINNED = [Requirement(line) for line in (ROOT / "docker" / "constraints.txt").read_text().splitlines() if "==" in line]


def test_no_pinned_version_asks_for_a_later_python_than_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    oldest = project["requires-python"].removeprefix(">=") + ".2"  # Debian 12's
    asked = {}
    for one in PINNED:
        try:
            asked[one.name] = metadata.metadata(one.name)["Requires-Python"]
        except metadata.PackageNotFoundError:  # of another system, or an extra that is not installed here
            continue
    assert len(asked) > 100
    assert not {name: python for name, python in asked.items() if python and oldest not in SpecifierSet(python)}
