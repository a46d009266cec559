"""Set-up's script that installs packages of npm: quiet, and where it fails it says why and what to do."""

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "docker" / "node-packages.sh"
NEEDED = ("dirname", "sh")


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder with all programs that there are."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in NEEDED:
        (folder / name).symlink_to(
            next(path for path in map(Path, ("/bin", "/usr/bin")) if (path / name).exists()) / name
        )
    return folder


def program(folder: Path, name: str, script: str) -> None:
    (folder / name).write_text(f"#!/bin/sh\n{script}\n")
    (folder / name).chmod(0o755)


def install(programs: Path, home: Path) -> "subprocess.CompletedProcess[str]":
    """Run the script for a folder `console`, on a machine with these programs and an empty home."""
    home.mkdir()
    run = ["sh", os.fspath(SCRIPT), "console", "python"]
    environment = {"PATH": os.fspath(programs), "HOME": os.fspath(home)}
    return subprocess.run(run, env=environment, capture_output=True, text=True, check=False)


def test_nothing_is_said_where_all_is_well(programs: Path, tmp_path: Path) -> None:
    program(programs, "node", "exit 0")
    program(programs, "npm", 'echo "added 5 packages"; echo "$@" > "$HOME/asked"')
    done = install(programs, tmp_path / "home")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    asked = (tmp_path / "home" / "asked").read_text()
    assert asked.startswith("ci --prefix console ")
    assert "--ignore-scripts" in asked


@pytest.mark.parametrize("with_npm", [True, False], ids=["npm", "PyPI's"])
def test_why_npm_failed_is_said_and_what_to_do(with_npm: bool, programs: Path, tmp_path: Path) -> None:
    fails = "echo 'npm error ENOTFOUND registry.npmjs.org' >&2; exit 7"
    if with_npm:
        program(programs, "node", "exit 0")
        program(programs, "npm", fails)
    else:
        program(programs, "python", f'[ "$1" = -m ] || {{ {fails}; }}')
    done = install(programs, tmp_path / "home")
    assert done.returncode == 1
    reason, said = done.stderr.splitlines()
    assert reason == "npm error ENOTFOUND registry.npmjs.org"
    assert said.startswith("npm did not install the packages of console/package-lock.json. ")
    assert "NPM_CONFIG_REGISTRY" in said
    assert done.stdout == ""


def test_a_machine_without_npm_and_pypi_is_told_what_it_lacks(programs: Path, tmp_path: Path) -> None:
    program(programs, "python", "echo 'ERROR: No matching distribution found' >&2; exit 1")
    done = install(programs, tmp_path / "home")
    assert done.returncode == 1
    reason, said = done.stderr.splitlines()
    assert reason == "ERROR: No matching distribution found"
    assert "install Node.js with npm" in said
