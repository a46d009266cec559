"""A job of a dropped file whose worker died too often, and that is tried again."""

import time
from contextlib import ExitStack
from io import BytesIO

import pytest

from service.jobs import contents, dropped
from service.jobs.dead import WORKER_LOST, retry
from service.jobs.dropped import Output
from service.jobs.ledger import Ledger
from service.jobs.models import ArtifactKind, Job
from tests.service.conftest import Client
from tests.service.watched import Watched, accepted, outputs, run
from tests.worker.engines import asset
from worker.hook_outputs import write_outputs


def dead(client: Client, job_id: str) -> None:
    """Let the job's worker die too often."""
    ledger = client.worker.ledger
    assert ledger.claim(job_id, 0.001)
    time.sleep(0.01)
    assert ledger.recover(1, WORKER_LOST) == ([], [job_id])


def claimed(ledger: Ledger, job_id: str) -> Job:
    job = ledger.claim(job_id, 60)
    assert job is not None
    return job


def test_a_dead_job_that_is_tried_again_has_all_that_it_was_sent(client: Client) -> None:
    ledger, store = client.worker.ledger, client.artifacts
    parts = (ArtifactKind.INPUT, ArtifactKind.FONT, ArtifactKind.LOGO)
    with ExitStack() as stack:
        staged = {kind: stack.enter_context(store.stage(BytesIO(kind.encode()), limit=9, name=kind)) for kind in parts}
        job_id = contents.create_job(ledger, store, "a.obj", {"text": "HI"}, staged).id
    dead(client, job_id)
    again = ledger.get(retry(ledger, store, job_id).id)
    assert again is not None
    assert {item.kind: item.sha256 for item in again.artifacts} == {kind: staged[kind].sha256 for kind in parts}


@pytest.mark.parametrize("brought", [False, True])
def test_the_results_of_a_dead_job_that_is_tried_again_are_written_back(
    brought: bool, hooked_on_both: Client, watched: Watched
) -> None:
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(hooked_on_both, watched.notification("incoming/a.obj"))
    ledger, store = hooked_on_both.worker.ledger, hooked_on_both.artifacts
    if brought:
        with store.stage(BytesIO(asset()), limit=10_000, name="file") as staged:
            lease = claimed(ledger, job_id).lease
            assert contents.publish(ledger, store, lease, ArtifactKind.INPUT, staged)
            assert ledger.release(lease)
    dead(hooked_on_both, job_id)
    write_outputs(hooked_on_both.worker, "shop")
    assert outputs(hooked_on_both) == ["none"]
    again = retry(ledger, store, job_id)
    assert accepted(hooked_on_both, watched.notification("incoming/a.obj")) == [again.id]
    assert run(hooked_on_both, again.id)["state"] == "succeeded"
    write_outputs(hooked_on_both.worker, "shop")
    assert outputs(hooked_on_both) == ["written"]
    assert watched.read("watermarked/a.obj.watermarked.glb") == b"glTF of HI"


def test_a_dead_job_that_is_tried_again_while_a_worker_looks_at_it_is_not_taken_for_done(
    hooked_on_both: Client, watched: Watched
) -> None:
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(hooked_on_both, watched.notification("incoming/a.obj"))
    dead(hooked_on_both, job_id)
    sessions = hooked_on_both.worker.ledger.sessions
    item = dropped.take_due(sessions, "shop")
    assert item is not None
    again = retry(hooked_on_both.worker.ledger, hooked_on_both.artifacts, job_id)
    dropped.settle(sessions, item, Output.NONE)
    assert run(hooked_on_both, again.id)["state"] == "succeeded"
    write_outputs(hooked_on_both.worker, "shop")
    assert outputs(hooked_on_both) == ["written"]
