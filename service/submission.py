"""From what a client asks for to a recorded job, whichever way the asset comes."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any, NamedTuple

from sqlalchemy.orm import Session

from core.errors import MeshmarkError
from core.parameters import Parameters
from service.errors import ServiceErrorCode
from service.intake import Verdicts
from service.jobs import contents, idempotency, queue
from service.jobs.artifacts import Staged
from service.jobs.ledger import Submission
from service.jobs.limits import check_active
from service.jobs.models import ArtifactKind, Job, Priority
from service.jobs.quota import check_stored
from service.state import AppState


def _nothing(_session: Session, _job_id: str) -> None:
    pass


@dataclass(frozen=True)
class Order:
    """What a client asks for.

    Attributes:
        tenant: whose job it will be.
        filename: what the client calls the asset.
        parameters: what to emboss and how.
        metadata: what the client notes about the job.
        asset: stages the asset while it is entered; None where a worker brings it later.
        origin: where the worker brings it from, as far as it tells this order from another one.
        record: called in the transaction that records the job, with its id: what else is recorded with it.
        priority: which of the tenant's waiting jobs goes first.
        webhook: where to tell how the job ends, if the client names it.
        font: stages the font, if there is one.
        key: the client's idempotency key.
        cache: whether results that exist already will do.
    """

    tenant: str
    filename: str
    parameters: Parameters
    metadata: Mapping[str, str]
    asset: AbstractContextManager[Staged] | None
    origin: Mapping[str, str] = field(default_factory=dict)
    record: Callable[[Session, str], None] = _nothing
    priority: Priority = Priority.NORMAL
    webhook: str | None = None
    font: AbstractContextManager[Staged] | None = None
    key: str | None = None
    cache: bool = True


class Accepted(NamedTuple):
    """The job of an order; `replayed`: an earlier request with the same idempotency key had made it."""

    job: Job
    replayed: bool = False


def submit(state: AppState, order: Order, known: Verdicts | None = None) -> Accepted:
    """Record a job, unless what can be seen at once speaks against it. Announcing it is left to the caller.

    Args:
        state: the app's.
        order: what is asked for.
        known: what is known of the uploads of other orders of the same request.

    Raises:
        MeshmarkError: what is wrong with the asset, the font, the text or the idempotency key; ``too_many_jobs``;
            ``quota_exceeded``.
        StoreUnavailableError: then nothing is recorded.
    """
    with ExitStack() as stack:
        parts = {ArtifactKind.INPUT: order.asset, ArtifactKind.FONT: order.font}
        staged = {kind: stack.enter_context(part) for kind, part in parts.items() if part is not None}
        asset, font = staged.get(ArtifactKind.INPUT), staged.get(ArtifactKind.FONT)
        state.intake.check(order.tenant, order.parameters.text, asset, font, known)
        wanted = order.parameters.model_dump(mode="json")
        reservation: idempotency.Reservation | None = None
        if order.key is not None:
            content: dict[str, Any] = {
                "parameters": wanted,
                "metadata": dict(order.metadata),
                "priority": order.priority,
                **order.origin,
            }
            content |= {"webhook": order.webhook} if order.webhook else {}
            content |= {kind.value: item.sha256 for kind, item in staged.items()}
            sessions = state.ledger.sessions
            reserved = idempotency.reserve(sessions, order.tenant, order.key, idempotency.fingerprint(content))
            if isinstance(reserved, str):
                return Accepted(_recorded(state, order.tenant, reserved), replayed=True)
            reservation = reserved
            stack.enter_context(idempotency.holding(sessions, reservation))

        def condition(session: Session, job_id: str) -> None:
            if state.settings.max_active_jobs:
                check_active(session, order.tenant, state.settings.max_active_jobs)
            check_stored(session, order.tenant, state.settings.max_stored_bytes)
            order.record(session, job_id)
            if reservation is not None:
                idempotency.settle(session, reservation, job_id)

        cache = order.cache and state.settings.cache
        submission = Submission(
            tenant=order.tenant,
            metadata=order.metadata,
            webhook=order.webhook,
            cache=cache,
            condition=condition,
            queue=queue.queue_for(state.settings, asset.size if asset else None),
            priority=order.priority,
        )
        return Accepted(contents.create_job(state.ledger, state.artifacts, order.filename, wanted, staged, submission))


def plain_name(filename: str | None) -> str:
    """The last part of what somebody calls a file, without anything that does not print."""
    name = PurePath((filename or "").replace("\\", "/")).name
    return "".join(character for character in name if character.isprintable())[-120:] or "asset"


def _recorded(state: AppState, tenant: str, job_id: str) -> Job:
    job = state.ledger.get(job_id, tenant)
    if job is None:  # a key goes with its job
        raise MeshmarkError(
            ServiceErrorCode.NOT_FOUND, f"There is no job {job_id!r}.", "Send the request with a new key."
        )
    return job
