from typing import Any

import pytest

from tests.audit import CONSTRAINTS, verdict

CLEAR: dict[str, Any] = {"name": "numpy", "version": "2.4.6", "vulns": []}
SKIPPED = {"name": "torch", "skip_reason": "Dependency not found on PyPI and could not be audited: torch (2.13.0)"}
VULNERABLE = {
    "name": "h11",
    "version": "0.1",
    "vulns": [{"id": "CVE-2025-1", "fix_versions": ["0.16.0"], "aliases": []}],
}


@pytest.mark.parametrize(
    ("packages", "status", "told"),
    [
        ([CLEAR, CLEAR], 0, "2 packages, no known vulnerability"),
        ([CLEAR, SKIPPED], 2, "1 of 2 packages could not be looked up: this is no result"),
        ([], 2, "0 of 0 packages could not be looked up: this is no result"),
        ([VULNERABLE, SKIPPED], 1, "h11 0.1: CVE-2025-1, fixed in 0.16.0"),
    ],
)
def test_only_packages_that_were_all_looked_up_are_clear(
    packages: list[dict[str, Any]], status: int, told: str
) -> None:
    assert verdict({"dependencies": packages}) == (status, [told])


def test_every_line_that_is_audited_is_a_pinned_version() -> None:
    lines = [line for line in CONSTRAINTS.read_text().splitlines() if not line.startswith("#")]
    assert [line for line in lines if line.count("==") != 1] == []
