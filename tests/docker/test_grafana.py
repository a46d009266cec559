"""The dashboard asks for nothing that is not served."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import promql_parser
import pytest
import yaml
from prometheus_client import REGISTRY

from core.credentials.sign import Signer
from service.config import Settings
from service.credentials import require_chain
from service.jobs.ledger_metrics import LedgerCollector
from service.jobs.models import Queue
from service.metrics import metrics_server
from service.webhooks.deliveries import announce
from tests.service.conftest import client_with
from tests.service.harness import free_port
from tests.service.metrics import scrape
from tests.worker.engines import asset
from tests.worker.test_signer import order, self_signed
from worker.signer import SignerProcess
from worker.webhooks import Sender

DOCKER = Path(__file__).parents[2] / "docker"
DASHBOARD: dict[str, Any] = json.loads((DOCKER / "grafana" / "meshmark.json").read_text())
EXPRESSIONS = [target["expr"] for panel in DASHBOARD["panels"] for target in panel["targets"]]
KEDA = [
    rule["spec"]["triggers"][0]["metadata"]["query"]
    for folder in ("base", "gpu")
    for rule in yaml.safe_load_all((DOCKER / "kubernetes" / folder / "scaling.yaml").read_text())
]
BY_PROMETHEUS = {"le", "job", "instance"}  # what it adds itself, or histograms have


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, set[str]]]:
    """The labels of every sample that is served once jobs succeeded, signed, and failed and a webhook was tried, by its
    name."""
    port, nobody = free_port(), free_port()
    settings = Settings(
        data_dir=tmp_path_factory.mktemp("served"),
        **self_signed(tmp_path_factory.mktemp("chain")),
        outbound_networks="127.0.0.0/8",  # type: ignore[arg-type]
        outbound_ports=str(nobody),  # type: ignore[arg-type]
        outbound_http=True,
    )
    with client_with(settings) as client:
        client.http.post("/v1/webhook-endpoints", json={"url": f"http://127.0.0.1:{nobody}/"})
        for sent in (order(), asset("refuse")):
            client.run(client.submit(sent))
        signer = SignerProcess(settings, Signer(require_chain(settings)))
        signer.sign_due()
        signer.ledger.close()
        assert client.http.get("/nothing").status_code == 404
        sender = Sender(settings, client.worker.celery)
        for delivery_id in announce(sender.ledger.sessions, False):
            sender.send(delivery_id)
        sender.ledger.close()
        with metrics_server("127.0.0.1", port, LedgerCollector(client.worker.ledger.sessions)):
            samples = [sample for family in scrape(port) for sample in family.samples]
        yield {
            name: set().union(*(item.labels for item in samples if item.name == name))
            for name in {s.name for s in samples}
        }


def selectors(node: object) -> Iterator[promql_parser.VectorSelector]:
    """Every series that an expression reads."""
    if isinstance(node, promql_parser.VectorSelector):
        yield node
    for name in ("expr", "lhs", "rhs", "param", "vector_selector", "args"):
        child = getattr(node, name, None)
        for item in child if isinstance(child, list) else [child]:
            if item is not None:
                yield from selectors(item)


@pytest.mark.parametrize("expression", [*EXPRESSIONS, *KEDA])
def test_every_expression_is_promql_over_metrics_and_labels_that_are_served(
    expression: str, served: dict[str, set[str]]
) -> None:
    parsed = promql_parser.parse(expression.replace("$__rate_interval", "5m"))
    read = list(selectors(parsed))
    assert {item.name for item in read} == set(re.findall(r"(?:meshmark|process)_\w+", expression))
    for item in read:
        assert item.name is not None
        assert item.name in served
        assert {matcher.name for matcher in item.matchers.matchers} <= served[item.name]
    grouped = {
        label.strip()
        for group in re.findall(r"(?:by|on|group_left) \(([^)]*)\)", expression)
        for label in group.split(",")
    }
    assert grouped - BY_PROMETHEUS <= set().union(*(served[item.name or ""] for item in read))


def test_each_queue_has_a_rule_by_which_its_workers_are_scaled() -> None:
    read = [
        {matcher.name: matcher.value for matcher in item.matchers.matchers}
        for query in KEDA
        for item in selectors(promql_parser.parse(query))
    ]
    assert read == [{"queue": queue} for queue in Queue]


def test_legends_name_labels_that_their_expressions_keep() -> None:
    for panel in DASHBOARD["panels"]:
        for target in panel["targets"]:
            for label in re.findall(r"\{\{(\w+)\}\}", target["legendFormat"]):
                assert re.search(rf"(by|on|group_left) \([^)]*\b{label}\b[^)]*\)", target["expr"]), target


def test_the_dashboard_shows_every_metric_of_ours() -> None:
    shown = " ".join(EXPRESSIONS)
    for family in REGISTRY.collect():
        if family.name.startswith("meshmark_"):
            assert family.name in shown


def test_panels_do_not_overlap() -> None:
    cells = [
        (column, row)
        for panel in DASHBOARD["panels"]
        for column in range(panel["gridPos"]["x"], panel["gridPos"]["x"] + panel["gridPos"]["w"])
        for row in range(panel["gridPos"]["y"], panel["gridPos"]["y"] + panel["gridPos"]["h"])
    ]
    assert len(cells) == len(set(cells))
    assert max(column for column, _ in cells) < 24


def test_grafana_finds_prometheus_and_prometheus_finds_the_processes_of_the_compose_file() -> None:
    compose = yaml.safe_load((DOCKER / "compose.yaml").read_text())
    more = yaml.safe_load((DOCKER / "compose.credentials.yaml").read_text())["services"]
    (source,) = yaml.safe_load((DOCKER / "grafana/provisioning/datasources/prometheus.yaml").read_text())["datasources"]
    assert source["url"] == "http://prometheus:9090"
    assert "prometheus" in compose["services"]
    for job in yaml.safe_load((DOCKER / "prometheus/prometheus.yaml").read_text())["scrape_configs"]:
        (found,) = job["dns_sd_configs"]
        (name,) = found["names"]
        variable = f"MESHMARK_{name.upper()}_METRICS_PORT".replace("API_", "")
        assert {**more, **compose["services"]}[name]["environment"][variable] == str(found["port"])
