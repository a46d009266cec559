"""Webhooks to be sent, and what came of those that were.

The rows are the truth, and a message in the queue is a delivery's id. Who sends one claims it first: the claim counts
for LEASE, so that what a killed process had claimed is found to be due again, and has a token, so that a process that
was taken for dead and is not records nothing. It may have sent by then: a delivery is made at least once, and receivers
tell repetitions by their id. Nothing is promised about the order.
"""

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, NamedTuple

from sqlalchemy import func, literal, or_, select, tuple_, update
from sqlalchemy.orm import Session, sessionmaker

from core.errors import ErrorCode, MeshmarkError
from service.jobs.ledger import now
from service.jobs.models import (
    DeliveryState,
    DisabledReason,
    UtcDateTime,
    WebhookAttempt,
    WebhookDelivery,
    WebhookEndpoint,
)
from service.webhooks.deliver import Outcome, Result
from service.webhooks.endpoints import find_endpoint, give_up, secrets_of
from service.webhooks.payload import Message

LEASE = timedelta(seconds=60)  # three times what an attempt takes at most
PER_TENANT = 16  # webhooks of a tenant on their way at a time: slow endpoints of one do not hold up all others
STATES = {
    Result.DELIVERED: DeliveryState.DELIVERED,
    Result.RETRY: DeliveryState.PENDING,
    Result.EXHAUSTED: DeliveryState.EXHAUSTED,
    Result.ENDPOINT_GONE: DeliveryState.EXHAUSTED,
}

Sessions = sessionmaker[Session]


@dataclass(frozen=True)
class Claim:
    """The right to make one attempt, and what it takes."""

    delivery_id: str
    token: int
    endpoint_id: str
    is_endpoints_own: bool  # the URL
    url: str
    secrets: list[str]  # as they are stored
    message: Message
    attempt: int
    since: datetime


class Page(NamedTuple):
    """Some deliveries, and the cursor of those that follow; None: there are no more."""

    deliveries: list[WebhookDelivery]
    cursor: str | None


def announce(sessions: Sessions, lost: bool) -> list[str]:
    """What is due and not in the queue yet. It counts as announced from here on, so announce it.

    Args:
        lost: take what was announced long ago and never claimed too; the queue is empty, so its messages were lost.
    """
    moment = now()
    silent = (
        WebhookDelivery.announced_at.is_(None),
        *([WebhookDelivery.announced_at < moment - LEASE] if lost else []),
    )
    wanted = (WebhookDelivery.state == DeliveryState.PENDING, WebhookDelivery.due_at <= moment, or_(*silent))
    turn = func.row_number().over(
        partition_by=WebhookEndpoint.tenant_id,
        order_by=(WebhookDelivery.announced_at.is_(None), WebhookDelivery.due_at),  # those on their way come first
    )
    underway = or_(WebhookDelivery.due_at <= moment, WebhookDelivery.announced_at.is_not(None))
    ranked = (
        select(WebhookDelivery.id, turn.label("turn"))
        .join(WebhookEndpoint, WebhookEndpoint.id == WebhookDelivery.endpoint_id)
        .where(WebhookDelivery.state == DeliveryState.PENDING, underway)
        .subquery()
    )
    chosen = select(ranked.c.id).where(ranked.c.turn <= PER_TENANT)
    with sessions() as session:  # most looks find nothing, and then take no lock
        if session.scalar(select(WebhookDelivery.id).where(*wanted).limit(1)) is None:
            return []
    free = select(WebhookDelivery.id).where(*wanted, WebhookDelivery.id.in_(chosen)).with_for_update(skip_locked=True)
    announced = update(WebhookDelivery).where(WebhookDelivery.id.in_(free), *wanted).values(announced_at=moment)
    with sessions.begin() as session:
        found = announced.returning(WebhookDelivery.id).execution_options(synchronize_session=False)
        return list(session.scalars(found))


def withdraw(sessions: Sessions, delivery_ids: list[str]) -> None:
    """Let be announced again what could not be."""
    announced = update(WebhookDelivery).where(WebhookDelivery.id.in_(delivery_ids)).values(announced_at=None)
    with sessions.begin() as session:
        session.execute(announced.execution_options(synchronize_session=False))


def claim(sessions: Sessions, delivery_id: str) -> Claim | None:
    """Take a delivery that is due, or None where it is not (or no longer) there to be taken."""
    moment = now()
    due = (
        WebhookDelivery.id == delivery_id,
        WebhookDelivery.state == DeliveryState.PENDING,
        WebhookDelivery.due_at <= moment,
    )
    with sessions.begin() as session:
        if not _set(session, due, due_at=moment + LEASE, token=WebhookDelivery.token + 1):
            return None
        delivery = session.get_one(WebhookDelivery, delivery_id)
        endpoint = delivery.endpoint
        url = delivery.url or endpoint.url
        if endpoint.disabled_reason or not url:  # disabled at the moment at which this delivery was noted
            _set(session, due[:1], state=DeliveryState.EXHAUSTED, due_at=None, announced_at=None)
            return None
        return Claim(
            delivery_id,
            delivery.token,
            endpoint.id,
            delivery.url is None,
            url,
            secrets_of(endpoint, moment),
            Message.about(delivery.event),
            delivery.attempts + 1,
            moment,
        )


def settle(sessions: Sessions, claim: Claim, outcome: Outcome) -> bool:
    """Record what came of an attempt; False when it is another's by now.

    An endpoint that is gone is disabled, and what waits for it is given up; of a job's own webhook, only this delivery.
    """
    gone = outcome.result is Result.ENDPOINT_GONE and claim.is_endpoints_own
    mine = (WebhookDelivery.id == claim.delivery_id, WebhookDelivery.token == claim.token)
    values = {
        "state": STATES[outcome.result],
        "attempts": claim.attempt,
        "due_at": outcome.retry_at,
        "announced_at": None,
    }
    with sessions.begin() as session:
        if gone:  # before the delivery, in the order in which whoever deletes an endpoint locks them
            reason = update(WebhookEndpoint).where(WebhookEndpoint.id == claim.endpoint_id)
            session.execute(reason.values(disabled_reason=DisabledReason.GONE))
        if not _set(session, mine, **values):
            return False
        session.add(
            WebhookAttempt(
                delivery_id=claim.delivery_id,
                number=claim.attempt,
                started_at=claim.since,
                status=outcome.status,
                error=outcome.error,
                snippet=outcome.snippet,
                seconds=outcome.seconds,
            )
        )
        if gone:
            give_up(session, claim.endpoint_id)
        return True


def list_deliveries(
    sessions: Sessions, tenant: str, endpoint_id: str, state: DeliveryState | None, limit: int, cursor: str | None
) -> Page:
    """An endpoint's newest deliveries, or those after a cursor, which is the id of the last one before.

    Raises:
        MeshmarkError: ``not_found``; ``invalid_request``, the cursor is not one.
    """
    find_endpoint(sessions, tenant, endpoint_id)
    order = (WebhookDelivery.created_at, WebhookDelivery.id)
    wanted = select(WebhookDelivery).where(WebhookDelivery.endpoint_id == endpoint_id)
    if state:
        wanted = wanted.where(WebhookDelivery.state == state)
    if cursor is not None:
        last = _find(sessions, endpoint_id, cursor)
        if last is None:
            raise MeshmarkError(
                ErrorCode.INVALID_REQUEST,
                "The cursor is not one that a list of this endpoint's deliveries gave.",
                "Follow the link `next` of a list as it is, or leave out the cursor to begin anew.",
            )
        wanted = wanted.where(tuple_(*order) < tuple_(literal(last.created_at, UtcDateTime), literal(last.id)))
    with sessions() as session:
        found = list(session.scalars(wanted.order_by(*(column.desc() for column in order)).limit(limit + 1)))
    return Page(found[:limit], found[limit - 1].id if len(found) > limit else None)


def redeliver(sessions: Sessions, tenant: str, endpoint_id: str, delivery_id: str) -> WebhookDelivery:
    """Make a delivery due now, whatever came of it; it is the same message. The attempts made before still count.

    Raises:
        MeshmarkError: ``not_found`` or ``endpoint_disabled``.
    """
    endpoint = find_endpoint(sessions, tenant, endpoint_id)
    if endpoint.disabled_reason:
        raise MeshmarkError(
            ErrorCode.ENDPOINT_DISABLED,
            "The endpoint is disabled, so nothing is sent to it.",
            'Enable it first: PATCH it with {"disabled": false}.',
        )
    values = {"state": DeliveryState.PENDING, "due_at": now(), "announced_at": None}
    condition = (WebhookDelivery.id == delivery_id, WebhookDelivery.endpoint_id == endpoint_id)
    with sessions.begin() as session:
        if delivery_id.isprintable() and _set(session, condition, **values):
            return session.get_one(WebhookDelivery, delivery_id)
    raise MeshmarkError(
        ErrorCode.NOT_FOUND,
        f"The endpoint has no delivery {delivery_id[:64]!r}.",
        "List the endpoint's deliveries; they are kept for 30 days.",
    )


def _find(sessions: Sessions, endpoint_id: str, delivery_id: str) -> WebhookDelivery | None:
    with sessions() as session:
        found = session.get(WebhookDelivery, delivery_id) if delivery_id.isprintable() else None
    return found if found and found.endpoint_id == endpoint_id else None


def _set(session: Session, condition: Any, **values: Any) -> bool:
    result: Any = session.execute(
        update(WebhookDelivery).where(*condition).values(**values).execution_options(synchronize_session=False)
    )
    return bool(result.rowcount == 1)
