"""Checks of `make docker-test` itself, as far as they need no Docker engine."""

import json
import re
import subprocess
import sys
from pathlib import Path

import yaml

from core.formats.admission import admit, document_of
from core.gltf.scene import flatten
from tests.docker.deployment import LargeAsset
from tests.docker.engine import Footprint, processes_of
from tests.docker.images import BASES, COMPOSE, STANDINS, WEED
from tests.docker.test_compose import SERVICES
from tests.docker.test_dockerfile import TEXT
from tests.manual import command_lines, page

ROOT = Path(__file__).parents[2]


def test_every_image_of_others_has_a_stand_in() -> None:
    """But those of the profile that has nothing to do with the work."""
    images = {service["image"] for service in SERVICES.values() if "build" not in service and "profiles" not in service}
    assert {image.rpartition(":")[0] for image in images} | {"python"} == set(BASES)
    for kind in BASES.values():
        text = (STANDINS / f"{kind}.Dockerfile").read_text()
        assert text.startswith("# Stands in for Docker Hub's")
        assert "FROM meshmark-standin/debian" in text
    assert re.search(r"^ARG PYTHON=3\.11\.", TEXT, re.MULTILINE), "that of the stand-in"


def test_what_is_fetched_is_pinned_by_its_hash() -> None:
    for _, name, sha256 in (COMPOSE, WEED):
        assert re.search(r"\d+\.\d+", name)
        assert re.fullmatch(r"[0-9a-f]{64}", sha256)


def test_its_large_asset_is_one_and_of_the_size_it_says() -> None:
    asset = LargeAsset(3_000_001)
    first, second = (b"".join(asset.content(number)) for number in range(2))
    assert len(first) == len(second) == asset.size
    assert first != second
    surface = flatten(document_of(admit(first))).surface
    assert len(surface.faces) == 12


def test_it_is_a_target_and_a_ci_job_of_its_own() -> None:
    makefile = (ROOT / "Makefile").read_text()
    assert "$(PYTHON) -m tests.docker " in makefile
    assert "docker-test" not in (ROOT / ".ci" / "run").read_text()
    (test,) = re.findall(r"^test:.*\n(?:\t.*\n)*", makefile, re.MULTILINE)
    assert "docker" not in re.sub(r"docker/(system|node)-packages\.sh", "", test)
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yaml").read_text())["jobs"]
    calling = [name for name, job in jobs.items() if "make docker-test" in json.dumps(job)]
    assert calling == ["docker"]


def test_it_needs_nothing_but_pythons_own_library() -> None:
    """Nobody has to install torch on the machine to see the image with torch built."""
    subprocess.run([sys.executable, "-S", "-c", "import tests.docker.__main__"], cwd=ROOT, check=True)


def test_what_is_missing_is_one_line() -> None:
    """Here: root, whatever user runs this test."""
    script = "import os, runpy; os.geteuid = lambda: 1000; runpy.run_module('tests.docker', run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines() == ["docker-test: a Docker engine needs root: sudo make docker-test"]


def test_a_process_of_a_folder_is_found_while_it_runs(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "print('here', flush=True); input()", f"{tmp_path}/x"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout
        assert process.stdout.readline() == b"here\n"
        assert len(processes_of(tmp_path)) == 1
        process.communicate(b"\n")
    assert not processes_of(tmp_path)


def test_the_footprint_of_this_machine_is_its_links_and_rules() -> None:
    found = Footprint.now()
    assert "lo" in found.links
    assert found == Footprint.now()


def test_the_manual_has_the_lines_that_are_run() -> None:
    text = command_lines(page("deployment"))
    (start,) = re.findall(r"^docker run -d .*", text, re.MULTILINE)
    (apply,) = re.findall(r"^docker run --rm .*", text, re.MULTILINE)
    assert len(re.findall(r"^docker exec meshmark .*keys create", text, re.MULTILINE)) == 1
    for flag in ("--read-only", "--cap-drop ALL", "--security-opt no-new-privileges", "--tmpfs /tmp"):
        assert flag in start
        assert flag in apply
    assert "-p 127.0.0.1:8080:8080 -v meshmark:/var/lib/meshmark" in start
    assert "--network none" in apply
