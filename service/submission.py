"""Submission of jobs: from a client's order to a recorded job, for every source of the asset."""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import PurePath
from typing import Any, NamedTuple

import structlog
from sqlalchemy.orm import Session

from core.artwork.qr_code import check_code
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters
from core.verify.parameters import VerificationParameters
from service.errors import ServiceErrorCode
from service.intake import Verdicts
from service.jobs import contents, copies, idempotency, queue
from service.jobs.artifacts import Staged
from service.jobs.cache import copy_key
from service.jobs.copies import NewCopy
from service.jobs.known_texts import known_texts
from service.jobs.ledger import Content, Submission
from service.jobs.limits import check_active
from service.jobs.models import PUBLIC_TENANT, ArtifactKind, Job, JobKind, JobState, Priority
from service.jobs.quota import check_stored
from service.jobs.references import MissingContentError
from service.state import AppState

log = structlog.get_logger(__name__)

PUBLIC_JOBS = 50  # without a key that may wait and run at a time: some minutes' work of one worker


def _nothing(_session: Session, _job_id: str) -> None:
    pass


@dataclass(frozen=True)
class Order:
    """Order of a client for one job.

    Attributes:
        tenant: owner of the job.
        filename: the client's name of the asset.
        parameters: of a watermark, or of a verification; None for a conversion, which has none.
        metadata: the client's notes about the job.
        asset: stages the asset while it is entered; None where a worker downloads it later.
        origin: source of that download, as part of the request's fingerprint.
        record: called with the job's id in the transaction that records the job, to record more with it.
        priority: order among the tenant's own waiting jobs.
        webhook: URL to notify of the job's end, if the client names one.
        font: stages the font, if there is one.
        logo: stages the logo, if there is one.
        original: stages the original that a suspect file is compared with, if there is one.
        sidecar: stages the Content Credentials that came beside a suspect file, if there are any.
        key: the client's idempotency key.
        cache: accept results that exist already.
        copies: of a watermark, to be made at the places of its marks.
    """

    tenant: str
    filename: str
    parameters: Parameters | VerificationParameters | None
    metadata: Mapping[str, str]
    asset: AbstractContextManager[Staged] | None
    origin: Mapping[str, str] = field(default_factory=dict)
    record: Callable[[Session, str], None] = _nothing
    priority: Priority = Priority.NORMAL
    webhook: str | None = None
    font: AbstractContextManager[Staged] | None = None
    logo: AbstractContextManager[Staged] | None = None
    original: AbstractContextManager[Staged] | None = None
    sidecar: AbstractContextManager[Staged] | None = None
    key: str | None = None
    cache: bool = True
    copies: Sequence[NewCopy] = ()

    @property
    def kind(self) -> JobKind:
        """Kind of the job."""
        return kind_of(self.parameters)


class Accepted(NamedTuple):
    """Job of an order; `replayed`: an earlier request with the same idempotency key had made it.

    `started`: copies of it that wait to be announced, as it does.
    """

    job: Job
    replayed: bool = False
    started: Sequence[Job] = ()


def submit(state: AppState, order: Order, known: Verdicts | None = None) -> Accepted:
    """Check an order and record its job; announcing it is left to the caller.

    Args:
        state: the app's.
        order: the order.
        known: verdicts on uploads, shared by the orders of one request.

    Raises:
        MeshmarkError: an error of the asset, the font, the logo, the text, the original or the idempotency key;
            ``not_found``, ``not_ready``, for the job whose marks are looked for; ``too_many_jobs``; ``quota_exceeded``.
        StoreUnavailableError: then nothing is recorded.
    """
    if isinstance(order.parameters, Parameters):
        order.parameters.require_content(order.logo is not None)
        check_code(order.parameters)
    with ExitStack() as stack:
        parts = {
            ArtifactKind.INPUT: order.asset,
            ArtifactKind.FONT: order.font,
            ArtifactKind.LOGO: order.logo,
            ArtifactKind.ORIGINAL: order.original,
            ArtifactKind.SIDECAR: order.sidecar,
            ArtifactKind.TEXTS: _staged_texts(state, order),
        }
        staged = {kind: stack.enter_context(part) for kind, part in parts.items() if part is not None}
        asset, font, logo = map(staged.get, (ArtifactKind.INPUT, ArtifactKind.FONT, ArtifactKind.LOGO))
        if isinstance(order.parameters, Parameters):
            state.intake.check(order.tenant, order.parameters, asset, font, known, logo)
        elif order.parameters:
            state.intake.check_suspect(order.tenant, asset, staged.get(ArtifactKind.ORIGINAL))
        elif asset:
            state.intake.check_asset(order.tenant, asset)
        shared = _marked(state, order)
        wanted = order.parameters.model_dump(mode="json") if order.parameters else {}
        reservation: idempotency.Reservation | None = None
        if order.key is not None:
            content: dict[str, Any] = {
                "parameters": wanted,
                "metadata": dict(order.metadata),
                "priority": order.priority,
                **order.origin,
            }
            content |= {"webhook": order.webhook} if order.webhook else {}
            content |= {"copies": _told(order.copies)} if order.copies else {}
            content |= {kind.value: item.sha256 for kind, item in staged.items()}
            sessions = state.ledger.sessions
            reserved = idempotency.reserve(sessions, order.tenant, order.key, idempotency.fingerprint(content))
            if isinstance(reserved, str):
                return Accepted(_recorded(state, order.tenant, reserved), replayed=True)
            reservation = reserved
            stack.enter_context(idempotency.holding(sessions, reservation))

        started: list[Job] = []

        def condition(session: Session, job_id: str) -> None:
            if order.copies:
                job = session.get_one(Job, job_id)
                made = state.ledger.add_copies(session, job, asked, job.created_at, order.webhook)
                if job.state is JobState.SUCCEEDED:
                    started[:] = [copy for copy in made if copy.state is JobState.QUEUED]
            if most := PUBLIC_JOBS if order.tenant == PUBLIC_TENANT else state.settings.max_active_jobs:
                check_active(session, order.tenant, most)
            check_stored(session, order.tenant, state.settings.max_stored_bytes)
            order.record(session, job_id)
            if reservation is not None:
                idempotency.settle(session, reservation, job_id)

        if order.kind is JobKind.VERIFICATION and wanted["texts"] is None:  # as they are now, for every attempt
            wanted["texts"] = [] if shared else known_texts(state.ledger.sessions, order.tenant)
        cache = order.cache and state.settings.cache
        asked = _keyed(state, order.copies, order.parameters) if cache else order.copies
        submission = Submission(
            tenant=order.tenant,
            kind=order.kind,
            metadata=order.metadata,
            webhook=order.webhook,
            cache=cache,
            condition=condition,
            queue=queue.queue_for(state.settings, asset.size if asset else None),
            priority=order.priority,
            signed=state.settings.c2pa_chain is not None,
        )
        create = partial(contents.create_job, state.ledger, state.artifacts, order.filename, wanted)
        return Accepted(create(staged, submission, shared), started=started)


def _staged_texts(state: AppState, order: Order) -> AbstractContextManager[Staged] | None:
    if not order.copies:
        return None
    texts = json.dumps([copy.text for copy in order.copies]).encode()
    return state.artifacts.stage_chunks([texts], limit=len(texts), name="list of texts")


def _told(wanted: Sequence[NewCopy]) -> list[list[Any]]:
    """Copies as they were asked for."""
    return [[copy.text, copy.metadata] for copy in wanted]


def _keyed(state: AppState, wanted: Sequence[NewCopy], parameters: object) -> Sequence[NewCopy]:
    """Copies that may have the results of equal ones."""
    if not isinstance(parameters, Parameters):
        return wanted
    signed = state.settings.c2pa_chain is not None
    return [copy._replace(key=copy_key(parameters, copy.text, signed)) for copy in wanted]


def submit_copies(
    state: AppState, parent: Job, wanted: Sequence[NewCopy], webhook: str | None, key: str | None, cache: bool
) -> Accepted:
    """Record copies of a job that has succeeded; announcing those that wait is left to the caller.

    Args:
        state: the app's.
        parent: the job.
        wanted: the copies.
        webhook: where their ends are told.
        key: of idempotency, if there is one.
        cache: accept results that exist already.

    Returns:
        The first of the copies; ``started`` are all.

    Raises:
        MeshmarkError: an error of the idempotency key; ``job_expired``, its files are deleted; ``too_many_jobs``;
            ``quota_exceeded``.
    """
    sessions = state.ledger.sessions
    with ExitStack() as stack:
        reservation: idempotency.Reservation | None = None
        if key is not None:
            content = {"copy_of": parent.id, "copies": _told(wanted), "webhook": webhook}
            reserved = idempotency.reserve(sessions, parent.tenant_id, key, idempotency.fingerprint(content))
            if isinstance(reserved, str):
                first = _recorded(state, parent.tenant_id, reserved)
                return Accepted(first, True, copies.asked_together(sessions, first, len(wanted)))
            reservation = reserved
            stack.enter_context(idempotency.holding(sessions, reservation))

        def condition(session: Session, job_id: str) -> None:
            check_active(session, parent.tenant_id, state.settings.max_active_jobs)
            check_stored(session, parent.tenant_id, state.settings.max_stored_bytes)
            if reservation is not None:
                idempotency.settle(session, reservation, job_id)

        if cache and state.settings.cache:
            wanted = _keyed(state, wanted, Parameters.model_validate(parent.parameters))
        try:
            made = state.ledger.copy(parent, wanted, state.artifacts.has, webhook, condition)
        except MissingContentError:
            raise MeshmarkError(
                ServiceErrorCode.JOB_EXPIRED,
                "The asset and the plan of this job were deleted.",
                "Send the asset again.",
            ) from None
    log.info("copies accepted", of=parent.id, copies=len(made))
    return Accepted(made[0], started=made)


def _marked(state: AppState, order: Order) -> dict[ArtifactKind, Content]:
    """The asset and the report of the job whose marks a verification is to look for; none where it names none.

    Raises:
        MeshmarkError: ``not_found``, ``not_ready``; ``invalid_request``, there is an original too.
    """
    job_id = order.parameters.watermark if isinstance(order.parameters, VerificationParameters) else None
    if job_id is None:
        return {}
    if order.original is not None:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "The request has an original and names a `watermark`, whose asset is the original.",
            "Send one of them only.",
        )
    job = state.ledger.get(job_id, order.tenant)
    if job is None or job.kind is not JobKind.WATERMARK:
        raise MeshmarkError(
            ServiceErrorCode.NOT_FOUND, f"There is no watermark {job_id!r}.", "Name a watermark job of yours."
        )
    roles = {ArtifactKind.ORIGINAL: ArtifactKind.INPUT, ArtifactKind.MARKED: ArtifactKind.REPORT}
    found = {role: Content(part.sha256, part.size) for role, kind in roles.items() if (part := job.artifact(kind))}
    if job.state is not JobState.SUCCEEDED or len(found) < len(roles):
        raise MeshmarkError(
            ServiceErrorCode.NOT_READY,
            f"The watermark {job_id} is {job.state}: it has no results to compare with.",
            "Name one that has succeeded and whose files are not deleted, or send the original.",
        )
    return found


def kind_of(parameters: Parameters | VerificationParameters | None) -> JobKind:
    """Kind of the jobs with such parameters."""
    if parameters is None:
        return JobKind.CONVERSION
    return JobKind.WATERMARK if isinstance(parameters, Parameters) else JobKind.VERIFICATION


def plain_name(filename: str | None) -> str:
    """Last part of a file name: its last 120 printable characters; `asset` where there are none."""
    name = PurePath((filename or "").replace("\\", "/")).name
    return "".join(character for character in name if character.isprintable())[-120:] or "asset"


def _recorded(state: AppState, tenant: str, job_id: str) -> Job:
    job = state.ledger.get(job_id, tenant)
    if job is None:  # a key goes with its job
        raise MeshmarkError(
            ServiceErrorCode.NOT_FOUND, f"There is no job {job_id!r}.", "Send the request with a new key."
        )
    return job
