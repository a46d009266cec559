"""`make audit`: known vulnerabilities of the pinned packages, by pip-audit from PyPI's advisories.

It needs the network, so it is no part of `make test`. What was not looked up is no good news: it fails.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

CONSTRAINTS = Path(__file__).parents[1] / "docker" / "constraints.txt"


def verdict(found: dict[str, Any]) -> tuple[int, list[str]]:
    """The exit status and the lines to print for pip-audit's JSON: 0 all clear, 1 vulnerable, 2 not looked up."""
    packages = found["dependencies"]
    skipped = [package for package in packages if "skip_reason" in package]
    lines = [
        f"{package['name']} {package['version']}: {item['id']}, fixed in {', '.join(item['fix_versions']) or 'nothing'}"
        for package in packages
        for item in package.get("vulns", ())
    ]
    if lines:
        return 1, lines
    if skipped or not packages:
        return 2, [f"{len(skipped)} of {len(packages)} packages could not be looked up: this is no result"]
    return 0, [f"{len(packages)} packages, no known vulnerability"]


def main() -> int:
    """Audit, and print what came of it."""
    options = ["--no-deps", "--disable-pip", "--progress-spinner", "off", "--format", "json"]
    command: list[str | Path] = [sys.executable, "-m", "pip_audit", "--requirement", CONSTRAINTS, *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        status, lines = verdict(json.loads(done.stdout))
    except ValueError:
        reason = (done.stderr.strip().splitlines() or ["no answer"])[-1]
        status, lines = 2, [f"the advisories could not be read, this is no result: {reason[:300]}"]
    print(*lines, sep="\n")
    return status


if __name__ == "__main__":
    sys.exit(main())
