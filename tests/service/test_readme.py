"""What the README says about the service is what the service does."""

import json
import re
from pathlib import Path

from prometheus_client import REGISTRY

from core.parameters import Parameters
from service.app import create_app
from service.config import Settings
from service.jobs.ledger_metrics import LedgerCollector
from service.jobs.models import JobState
from service.routes import events, watermarks
from service.show_settings import as_variable
from tests.service.conftest import Client

README = (Path(__file__).parents[2] / "README.md").read_text()


def rows(heading: str) -> list[list[str]]:
    """The cells of the first table under a heading, without its head."""
    section = README.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    table = [line.strip("|").split(" | ") for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in row] for row in table[2:]]


def test_the_table_of_settings_is_that_of_the_service() -> None:
    expected = [
        [f"`MESHMARK_{name.upper()}`", f"`{default}`" if (default := as_variable(field.default)) else "empty", text]
        for name, field in Settings.model_fields.items()
        if (text := field.description)
    ]
    assert rows("Configuration") == expected


def test_the_table_of_parameters_names_each_with_its_default() -> None:
    table = rows("Parameters")
    assert [name for name, _, _ in table] == [f"`{name}`" for name in Parameters.model_fields]
    for (_, default, _), field in zip(table, Parameters.model_fields.values(), strict=True):
        if field.is_required():
            assert default == "required"
        elif field.default is not None:
            assert default.strip("`") == str(field.default)
        else:
            assert default in ("preset", "`null`")


def test_the_table_of_metrics_is_that_of_the_processes(client: Client) -> None:
    ledger = LedgerCollector(client.worker.ledger.sessions)
    families = [family for collector in (REGISTRY, ledger) for family in collector.collect()]
    named = {row[0].strip("`") for row in rows("Observability")}
    ours = {
        family.name + {"counter": "_total", "info": "_info"}.get(family.type, "")
        for family in families
        if family.name.startswith("meshmark_")
    }
    assert named == ours


def test_the_example_of_an_error_is_what_the_service_answers(client: Client) -> None:
    example = re.search(r"```json\n(.*?)```", README, re.DOTALL)
    assert example is not None
    files = {"file": ("asset.stl", bytes(80) + b"\xff" * 4)}
    answer = client.http.post("/v1/watermarks", files=files, data={"params": '{"text": "watermark"}'})
    assert answer.json() == json.loads(example[1])


def test_every_state_of_a_job_is_named() -> None:
    states = re.search(r"\*\*Job states\*\*.*", README)
    assert states is not None
    assert set(re.findall(r"`(\w+)`", states[0])) == set(JobState)


def test_the_addresses_in_the_examples_exist() -> None:
    named = {re.sub(r"\$ID", "{job_id}", path) for path in re.findall(r"127\.0\.0\.1:8080(/v1\S*)", README)}
    routes = [*watermarks.router.routes, *events.router.routes]
    assert {route.path for route in routes} <= named  # type: ignore[attr-defined]
    assert named <= set(create_app(Settings()).openapi()["paths"])
