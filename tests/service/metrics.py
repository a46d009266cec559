"""Read what a process serves to Prometheus."""

import httpx2
from prometheus_client import Metric
from prometheus_client.parser import text_string_to_metric_families

from tests.worker.waiting import PATIENCE


def scrape(port: int) -> list[Metric]:
    """The figures of the process that serves them at this port."""
    response = httpx2.get(f"http://127.0.0.1:{port}/metrics", timeout=PATIENCE)
    assert response.status_code == 200
    return list(text_string_to_metric_families(response.text))


def value(families: list[Metric], sample: str, **labels: str) -> float:
    """The sum of all samples of a name that have these labels."""
    return sum(
        item.value
        for family in families
        for item in family.samples
        if item.name == sample and item.labels.items() >= labels.items()
    )


def label_values(families: list[Metric], label: str) -> set[str]:
    return {item.labels[label] for family in families for item in family.samples if label in item.labels}
