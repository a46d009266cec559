"""Copies that one process makes, one after the other."""

import json
import os
import select
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from service.config import Settings
from service.jobs.models import ArtifactKind, Job
from tests.service.conftest import Client, client_with
from tests.worker.engines import asset
from tests.worker.waiting import wait_until
from worker import series
from worker.runner import Session

TEXTS = ["ORDER-1", "ORDER-22", "ORDER-3"]


@pytest.fixture
def client(tmp_path: Path) -> Iterator[Client]:
    with client_with(Settings(data_dir=tmp_path)) as client:
        yield client


def post(client: Client, texts: list[str], do: str = "work", /, **details: Any) -> str:
    """The URL of a new job, whose models say which process made them."""
    data = {"params": '{"text": "HI"}'}
    if texts:
        data["copies"] = json.dumps([{"text": text} for text in texts])
    files = {"file": ("asset.obj", asset(do, sign=True, **details))}
    return str(client.http.post("/v1/watermarks", data=data, files=files).headers["Location"])


def copies(client: Client, url: str) -> list[dict[str, Any]]:
    return list(client.http.get(f"{url}/copies").json()["items"])


def outcomes(client: Client, url: str) -> list[str]:
    """Of each copy its error's code, else its state."""
    return [(copy["error"] or {}).get("code") or copy["state"] for copy in copies(client, url)]


def maker(client: Client, job: dict[str, Any]) -> bytes:
    """The id of the process that made a model, which is of its own text."""
    text, _, process = client.http.get(job["links"]["model"]).content.rpartition(b" by ")
    assert text.removeprefix(b"glTF of ").decode() == job.get("text", "HI")
    return bytes(process)


def test_the_process_of_a_job_makes_its_copies_too(client: Client) -> None:
    url = post(client, TEXTS)
    client.run(url)
    made = [client.http.get(url).json(), *copies(client, url)]
    assert [job["state"] for job in made] == ["succeeded"] * 4
    assert len({maker(client, job) for job in made}) == 1
    reports = [client.http.get(job["links"]["report"]).json() for job in made[1:]]
    assert [(report["text"], report["placed_for"]) for report in reports] == [(text, "ORDER-22") for text in TEXTS]
    assert not list(client.worker.scratch.iterdir())


def test_copies_of_a_job_that_is_done_share_a_process_of_their_own(client: Client) -> None:
    url = post(client, [])
    client.run(url)
    client.http.post(f"{url}/copies", json={"copies": [{"text": text} for text in TEXTS]})
    client.run(url)
    made = [client.http.get(url).json(), *copies(client, url)]
    assert len({maker(client, job) for job in made[1:]}) == 1
    assert len({maker(client, job) for job in made}) == 2


def test_other_jobs_go_before_copies_and_have_processes_of_their_own(client: Client) -> None:
    with_copies, other = post(client, TEXTS), post(client, [], number=2)
    client.run(with_copies)
    assert client.http.get(other).json()["state"] == "succeeded"
    assert outcomes(client, with_copies) == ["queued"] * 3
    client.run(with_copies)
    first, second = (client.http.get(url).json() for url in (with_copies, other))
    makers = [maker(client, job) for job in (first, second, *copies(client, with_copies))]
    assert len(set(makers)) == 3
    assert len(set(makers[2:])) == 1


def test_copies_of_two_jobs_are_not_made_by_one_process(client: Client) -> None:
    urls = post(client, ["A", "B"]), post(client, ["C", "D"], number=2)
    for url in urls:
        client.run(url)
    makers = [[maker(client, job) for job in copies(client, url)] for url in urls]
    assert [len(set(each)) for each in makers] == [1, 1]
    assert makers[0] != makers[1]


@pytest.mark.parametrize(
    ("end", "code"), [("refuse", "no_placement"), ("segfault", "engine_crashed"), ("run_out_of_memory", "memory_limit")]
)
def test_what_ends_a_process_ends_only_the_copy_that_it_makes(client: Client, end: str, code: str) -> None:
    url = post(client, TEXTS, **{"for": {"ORDER-22": end}})
    client.run(url)
    assert outcomes(client, url) == ["succeeded", code, "queued"]
    client.run(url)
    assert outcomes(client, url) == ["succeeded", code, "succeeded"]
    assert maker(client, copies(client, url)[0]) != maker(client, copies(client, url)[2])
    assert not list(client.worker.scratch.iterdir())


def test_a_process_that_dies_between_two_copies_ends_neither(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the kernel kills one where memory is short."""
    may_go_on = Session.may_go_on

    def die(session: Session) -> bool:
        os.kill(session._pid, signal.SIGKILL)
        wait_until(lambda: select.select([session._channel], [], [], 0.0)[0])
        return may_go_on(session)

    monkeypatch.setattr(Session, "may_go_on", die)
    url = post(client, TEXTS)
    client.run(url)
    assert outcomes(client, url) == ["succeeded"] * 3
    assert len({maker(client, job) for job in copies(client, url)}) == 3


def test_a_process_that_dies_when_it_is_asked_ends_the_copy_alone(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on = Session.go_on

    def die(session: Session, parameters: dict[str, Any], folder: Path) -> None:
        os.kill(session._pid, signal.SIGKILL)
        wait_until(lambda: select.select([session._channel], [], [], 0.0)[0])
        go_on(session, parameters, folder)

    monkeypatch.setattr(Session, "go_on", die)
    url = post(client, TEXTS[:1])
    client.run(url)
    assert outcomes(client, url) == ["engine_crashed"]


def test_a_folder_that_a_sweeper_has_removed_costs_a_new_process(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep = series.Series.keep

    def keep_and_sweep(kept: series.Series, job: Job) -> None:
        keep(kept, job)
        for folder in client.worker.scratch.iterdir():
            folder.rename(folder.with_name("swept"))

    monkeypatch.setattr(series.Series, "keep", keep_and_sweep)
    url = post(client, TEXTS[:1])
    client.run(url)
    assert outcomes(client, url) == ["succeeded"]
    assert maker(client, client.http.get(url).json()) != maker(client, copies(client, url)[0])


def test_a_process_that_has_taken_much_makes_no_further_copy(client: Client) -> None:
    client.worker.settings.job_memory_limit = 2**29
    url = post(client, TEXTS, "hoard")
    client.run(url)
    assert outcomes(client, url) == ["succeeded"] * 3
    assert len({maker(client, job) for job in copies(client, url)}) == 3


def test_a_copy_that_is_canceled_is_left_out(client: Client) -> None:
    url = post(client, TEXTS)
    client.http.delete(copies(client, url)[1]["links"]["self"])
    client.run(url)
    assert outcomes(client, url) == ["succeeded", "canceled", "succeeded"]
    assert client.http.get(copies(client, url)[0]["links"]["model"]).status_code == 200


def test_results_of_a_copy_are_not_taken_for_those_of_the_next(client: Client) -> None:
    """One whose process dies before it has written its report has none, although the copy before had."""
    url = post(client, TEXTS[:2], **{"for": {"ORDER-22": "leave"}})
    client.run(url)
    assert outcomes(client, url) == ["succeeded", "engine_crashed"]
    failed = client.http.get(copies(client, url)[1]["links"]["self"]).json()
    assert failed["links"]["report"] is None
    job = client.worker.ledger.get(failed["id"])
    assert job is not None
    assert job.artifact(ArtifactKind.MODEL) is None
