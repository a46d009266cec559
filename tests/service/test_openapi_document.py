"""The OpenAPI document as linters and generators of clients read it."""

import copy
import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.manual import ROOT

TESTS = ROOT / "tests"
DOCUMENT = yaml.safe_load((ROOT / "openapi.yaml").read_text())
OPERATIONS = [(method, operation) for path in DOCUMENT["paths"].values() for method, operation in path.items()]
QUIET = {"REDOCLY_TELEMETRY": "off", "REDOCLY_SUPPRESS_UPDATE_NOTICE": "true"}  # it asks nobody in the network


def lint(path: Path) -> list[tuple[str, str]]:
    """Rules of Redocly that a document breaks, each with what is wrong."""
    node, program = shutil.which("node"), TESTS / "node_modules" / "@redocly" / "cli" / "bin" / "cli.js"
    if node is None or not program.is_file():
        pytest.fail("Redocly is missing: install Node.js, then run `npm ci --prefix tests`.", pytrace=False)
    command: list[str | Path] = [node, program, "lint", path, "--config", TESTS / "redocly.yaml", "--format", "json"]
    done = subprocess.run(command, env=os.environ | QUIET, capture_output=True, text=True, check=False)
    assert done.stdout, done.stderr
    return [(problem["ruleId"], problem["message"]) for problem in json.loads(done.stdout)["problems"]]


def test_a_linter_finds_nothing_to_say_about_the_document() -> None:
    assert lint(ROOT / "openapi.yaml") == []


def test_the_linter_would_see_an_example_that_breaks_its_schema(tmp_path: Path) -> None:
    broken: dict[str, Any] = copy.deepcopy(DOCUMENT)
    del broken["components"]["schemas"]["Delivery"]["examples"][0]["state"]
    path = tmp_path / "openapi.json"
    path.write_text(json.dumps(broken))
    assert {rule for rule, _ in lint(path)} == {"no-invalid-schema-examples"}


def test_every_operation_is_summed_up_in_words_of_its_own() -> None:
    summaries = [operation["summary"] for _, operation in OPERATIONS]
    assert len(set(summaries)) == len(summaries)
    for method, operation in OPERATIONS:
        assert operation["summary"] != operation["operationId"].replace("_", " ").title(), "its function's name"
        assert operation["summary"].endswith("(headers only)") == (method == "head")


def test_files_are_bytes_to_every_generator_of_clients() -> None:
    forms = [schema for name, schema in DOCUMENT["components"]["schemas"].items() if name.startswith("Body_")]
    parts = [part for form in forms for part in form["properties"].values()]
    files = [part for part in parts if part.get("contentMediaType") == "application/octet-stream"]
    assert len(files) == 7
    assert {part["format"] for part in files} == {"binary"}


def test_head_is_described_without_content() -> None:
    heads = [operation["responses"] for method, operation in OPERATIONS if method == "head"]
    assert len(heads) >= 6
    for responses in heads:
        assert not [status for status, response in responses.items() if "content" in response]
        assert {"206", "307", "416"}.isdisjoint(responses)
