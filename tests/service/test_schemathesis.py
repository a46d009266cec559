"""Schemathesis calls every route of the OpenAPI document with what it allows and with what it does not."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import yaml

from service.__main__ import openapi
from service.routes.report_example import REPORT
from tests.service.harness import API_COMMAND, WORKER_COMMAND, Service, redis_server

DOCUMENT = yaml.safe_load(openapi())
OPERATIONS = [(path, method) for path, item in DOCUMENT["paths"].items() for method in item]
CONFIG = Path(__file__).with_name("schemathesis.toml")
EXAMPLES = 15  # of each route in each phase


def test_no_request_by_or_against_the_document_is_answered_otherwise_than_it_says(tmp_path: Path) -> None:
    with redis_server(tmp_path) as broker:
        service = Service(tmp_path, broker_url=broker, auth="keys", requests_per_minute="0")
        with service.running(API_COMMAND, WORKER_COMMAND):
            header = {"Authorization": f"Bearer {new_key(service)}"}
            service.client.headers.update(header)
            for url in [service.start_job(number=number, report=REPORT) for number in range(3)]:
                service.wait_for(url, "succeeded")
            report = tmp_path / "report.json"
            done = schemathesis(service.url, report, header)
            assert service.is_up(), "it lives on"
    assert done.returncode == 0, done.stdout[-8000:]
    told = re.search(r"Tested: (\d+)", done.stdout)
    assert told is not None
    assert int(told[1]) == len(OPERATIONS), "all routes"
    assert json.loads(report.read_text())


def schemathesis(url: str, report: Path, headers: dict[str, str]) -> "subprocess.CompletedProcess[str]":
    program = Path(sys.executable).parent / "st"
    shown = [text for name, value in headers.items() for text in ("--header", f"{name}: {value}")]
    command: list[str | Path] = [program, "--config-file", CONFIG, "run", f"{url}/openapi.json", *shown, "--no-color"]
    bounds: list[str | Path] = [
        "--max-examples",
        str(EXAMPLES),
        "--generation-deterministic",
        "--report-json-path",
        report,
    ]
    return subprocess.run(
        [*command, *bounds], cwd=report.parent, capture_output=True, text=True, check=False, timeout=300
    )


def new_key(service: Service) -> str:
    command = [sys.executable, "-m", "service", "keys", "create", "--tenant", "acme", "--name", "schemathesis"]
    made = subprocess.run(command, env=os.environ | service.environment, capture_output=True, text=True, check=True)
    key = re.search(r"mm_\w+", made.stdout)
    assert key is not None
    return key[0]


def test_every_operation_has_a_name_a_sentence_and_its_errors() -> None:
    operations = [DOCUMENT["paths"][path][method] for path, method in OPERATIONS]
    names = [operation["operationId"] for operation in operations]
    assert len(set(names)) == len(names)
    for (path, _), operation in zip(OPERATIONS, operations, strict=True):
        assert operation["description"].endswith("."), path
        if path != "/healthz":
            assert any(int(status) >= 400 for status in operation["responses"]), path


def test_every_answer_and_every_field_of_a_form_has_an_example() -> None:
    def has_example(schema: dict[str, Any]) -> bool:
        if "$ref" in schema:
            return has_example(DOCUMENT["components"]["schemas"][schema["$ref"].rpartition("/")[2]])
        alone = all("const" in item for item in schema.get("properties", {"": {}}).values())
        return "examples" in schema or schema.get("type") == "string" or alone

    for path, method in OPERATIONS:
        operation = DOCUMENT["paths"][path][method]
        for status, response in operation["responses"].items():
            for content in response.get("content", {}).values():
                assert "example" in content or has_example(content["schema"]), (path, status)
        form = operation.get("requestBody", {}).get("content", {}).get("multipart/form-data")
        if form:
            body = DOCUMENT["components"]["schemas"][form["schema"]["$ref"].rpartition("/")[2]]
            for name, field in body["properties"].items():
                assert "examples" in field or "contentMediaType" in field, (path, name)
