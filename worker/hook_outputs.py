"""Write the results of dropped objects back to their buckets.

A step of its own beside the jobs, in a thread for each hook: a bucket that fails or hangs delays no job and no other
bucket. Rows of a worker that died are taken by others, and writing twice is idempotent.
"""

from functools import partial

import structlog

from core.errors import MeshmarkError
from service.exports import HEAD, kind_of
from service.hooks.config import HookSource
from service.jobs import dropped
from service.jobs.artifacts import ArtifactStore
from service.jobs.dropped import Output
from service.jobs.models import ArtifactKind, DroppedObject, Job, JobState
from worker.hook_bucket import write_object
from worker.repeating import repeatedly
from worker.tasks import Worker

INTERVAL = 1.0  # seconds between two queries for due objects
SUFFIXES = {  # the model last
    ArtifactKind.REPORT: ".report.json",
    ArtifactKind.CREDENTIALS: ".watermarked.c2pa",
    ArtifactKind.PREVIEW_MANIFEST: ".watermarked.preview.c2pa",
    ArtifactKind.PREVIEW_MODEL: ".watermarked.preview.glb",
    ArtifactKind.MODEL: ".watermarked.glb",
}
MEDIA_TYPES = {
    ArtifactKind.REPORT: "application/json",
    ArtifactKind.CREDENTIALS: "application/c2pa",
    ArtifactKind.PREVIEW_MANIFEST: "application/c2pa",
    ArtifactKind.PREVIEW_MODEL: "model/gltf-binary",
    ArtifactKind.MODEL: "model/gltf-binary",
}

log = structlog.get_logger(__name__)


def write_outputs(worker: Worker, source: str) -> None:
    """Write the results of all jobs of a hook's objects that are due."""
    sessions = worker.ledger.sessions
    while not worker.stopping.is_set() and (item := dropped.take_due(sessions, source)):
        try:
            output = _write(worker, worker.settings.hooks[source], item)
        except MeshmarkError as error:
            log.warning(
                "results could not be written to their bucket; trying again", job=item.job_id, reason=str(error)
            )
            dropped.postpone(sessions, item)
        else:
            dropped.settle(sessions, item, output)
            log.info("a dropped object is done with", job=item.job_id, output=output.value)


def _write(worker: Worker, hook: HookSource, item: DroppedObject) -> Output:
    job = worker.ledger.get(item.job_id, hook.tenant)
    if job is None or job.state != JobState.SUCCEEDED:
        return Output.NONE
    if dropped.is_superseded(worker.ledger.sessions, item):
        return Output.SUPERSEDED
    try:
        _copy(worker.artifacts, hook, job, item.key)
    except FileNotFoundError:  # deleted since the ledger was read
        return Output.NONE
    return Output.WRITTEN


def _copy(store: ArtifactStore, hook: HookSource, job: Job, key: str) -> None:
    if export := job.artifact(ArtifactKind.EXPORT):
        with store.fetched(export.sha256, export.size) as path:
            with path.open("rb") as file:
                suffix, media_type = kind_of(file.read(HEAD))
            write_object(hook, hook.output_key(key, f".watermarked{suffix}"), path, media_type)
    for kind, suffix in SUFFIXES.items():
        if artifact := job.artifact(kind):
            with store.fetched(artifact.sha256, artifact.size) as path:
                write_object(hook, hook.output_key(key, suffix), path, MEDIA_TYPES[kind])


def start_writer(worker: Worker) -> None:
    """Write results in the background, for each hook, until the worker stops."""
    for source in worker.settings.hooks:
        repeatedly(f"hook-outputs-{source}", partial(write_outputs, worker, source), INTERVAL, worker.stopping)
