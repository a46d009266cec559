"""Consistency of the ledger's references to content with the content in the store.

The invariant: at every moment, each row of the ledger refers to content that the store has. Ledger and store know
nothing of each other's transactions, and content is shared by all jobs that have it, so two things could break it: a
row is written while its content is being removed, or content is removed while a row for it is being written.

Therefore both happen in a ledger transaction that holds a lock on the content's hash (the database's
own lock, so it holds between machines):

- A row is written only if the store has the content at that moment. If not, nothing is written, the content is put
  again, and the whole is tried again.
- Content is removed only if no row refers to it at that moment, and the lock is held until the store has answered.

Whichever comes first, the other one sees it: the remover sees the row, or the writer misses the content. Putting
content needs no lock: content that is never referred to, because the process died, is removed by the sweeper once it is
older than GRACE. The grace period is not what makes this safe; it only spares content that is just about to be
referred to from being put twice.

One assumption is left: a store does not carry out a deletion after its request was given up (after 30 seconds, and
counted as failed).
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from datetime import timedelta
from itertools import islice
from typing import Any, TypeVar

import structlog

from core.errors import MeshmarkError
from service.jobs import references
from service.jobs.artifacts import GRACE, ArtifactStore, Staged, StoreUnavailableError
from service.jobs.cache import find_results, result_key
from service.jobs.clock import now
from service.jobs.ledger import BY_DEFAULT, Content, Ledger, Submission
from service.jobs.models import ArtifactKind, Job, JobKind, Lease
from service.jobs.ownership import PAGE, claim
from service.jobs.references import MissingContentError

TRIES = 5  # to put and record; each that fails means that a removal came between two requests to the store

log = structlog.get_logger(__name__)
T = TypeVar("T")


def create_job(
    ledger: Ledger,
    store: ArtifactStore,
    filename: str,
    parameters: dict[str, Any],
    staged: Mapping[ArtifactKind, Staged],
    submission: Submission = BY_DEFAULT,
    shared: Mapping[ArtifactKind, Content] | None = None,
) -> Job:
    """Store a job's inputs and record the job; those it shares with another one are stored already.

    Raises:
        StoreUnavailableError: then nothing is recorded.
        MeshmarkError: raised by the submission's condition; then nothing is recorded and nothing kept.
    """
    contents = {kind: Content(item.sha256, item.size) for kind, item in staged.items()} | dict(shared or {})
    # A verification's page of evidence says when this very file was looked at: it is made anew each time.
    is_watermark = submission.kind is JobKind.WATERMARK
    key = result_key(parameters, contents, submission.signed) if is_watermark else None
    may_reuse = submission.cache

    def record() -> Job:
        nonlocal may_reuse
        results = find_results(ledger.sessions, submission.tenant, key) if may_reuse else {}
        may_reuse = False  # the results found may be about to be deleted with their job: then the work is done anew
        return ledger.create(filename, parameters, contents, store.has, submission, key, results)

    try:
        job = _keep(store, staged.values(), record)
    except StoreUnavailableError:
        raise
    except MeshmarkError:
        discard(ledger, store, {item.sha256 for item in staged.values()})
        raise
    log.info("job accepted", job=job.id)
    return job


def publish(ledger: Ledger, store: ArtifactStore, lease: Lease, kind: ArtifactKind, staged: Staged) -> bool:
    """Store an output and record it, in place of an earlier attempt's; False when the lease is void.

    Raises:
        StoreUnavailableError: then nothing is recorded.
    """
    content = Content(staged.sha256, staged.size)
    published = _keep(store, [staged], lambda: ledger.publish(lease, kind, content, store.has))
    if not published:
        discard(ledger, store, {staged.sha256})
    return published


def discard(ledger: Ledger, store: ArtifactStore, hashes: Iterable[str]) -> None:
    """Remove content that no row refers to any more; the sweeper removes later whatever the store does not remove
    now."""
    for sha256 in hashes:
        try:
            references.discard(ledger.sessions, sha256, store.remove)
        except StoreUnavailableError:
            log.warning("content without a reference could not be removed; a sweeper will", sha256=sha256)


def discard_orphans(ledger: Ledger, store: ArtifactStore, prefix: str = "", grace: float = GRACE) -> set[str]:
    """Remove content that no row refers to and that is older than the grace period; returns its hashes.

    Raises:
        ForeignStoreError: the store is not this ledger's; nothing is removed.
    """
    claim(ledger, store)
    cutoff = now() - timedelta(seconds=grace)
    old = (item.sha256 for item in store.listing(prefix) if item.since < cutoff)
    orphans: set[str] = set()
    while page := list(islice(old, PAGE)):
        orphans |= references.unreferenced(ledger.sessions, page)
    discard(ledger, store, orphans)
    return orphans


def _keep(store: ArtifactStore, staged: Collection[Staged], record: Callable[[], T]) -> T:
    for _ in range(TRIES):
        for item in staged:
            store.put(item)  # also content that is there: a faster answer would reveal that another tenant has sent it
        with suppress(MissingContentError):
            return record()
    raise StoreUnavailableError
