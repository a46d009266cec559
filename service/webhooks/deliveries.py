"""Deliveries of webhooks: announcement, claim, outcome and redelivery.

The rows are the truth, and a message in the queue is a delivery's id. A sender claims a delivery first: the claim is a
lease of LEASE, after which a delivery claimed by a killed process is due again, and has a token, so that a process
whose lease has expired records nothing. It may have sent by then: a delivery is made at least once, and receivers
recognize repetitions by their id. No order is guaranteed.
"""

import random
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, NamedTuple

from sqlalchemy import Select, exists, func, literal, select, tuple_, union_all, update
from sqlalchemy.orm import Session, sessionmaker

from core.errors import ErrorCode, MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs.clock import clock
from service.jobs.erasure import erase_events
from service.jobs.models import (
    UNDER_WAY,
    WAITING,
    DeliveryState,
    DisabledReason,
    Job,
    UtcDateTime,
    WebhookAttempt,
    WebhookDelivery,
    WebhookEndpoint,
)
from service.webhooks.deliver import Outcome, Result
from service.webhooks.endpoints import find_endpoint, give_up, secrets_of
from service.webhooks.payload import Message

LEASE = timedelta(seconds=60)  # three times the longest attempt
PER_TENANT = 16  # webhooks of a tenant under way at a time: one tenant's slow endpoints do not delay all others
TENANTS = 500  # with announcements in one sweep, drawn by chance where there are more
PUT_BACK = timedelta(seconds=1)  # until a delivery that was put back is due again
STATES = {
    Result.DELIVERED: DeliveryState.DELIVERED,
    Result.RETRY: DeliveryState.PENDING,
    Result.EXHAUSTED: DeliveryState.EXHAUSTED,
    Result.ENDPOINT_GONE: DeliveryState.EXHAUSTED,
}

Sessions = sessionmaker[Session]


@dataclass(frozen=True)
class Claim:
    """Right to make one attempt, and its data."""

    delivery_id: str
    token: int
    endpoint_id: str
    tenant: str
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
    """Due deliveries that are not in the queue yet. They count as announced from here on, so announce them.

    However many wait, a call costs some steps in an index for each tenant with waiting deliveries.

    Args:
        lost: include those announced long ago and never claimed; the queue is empty, so their messages were lost.
    """
    if lost:
        with sessions.begin() as session:
            moment = clock(session)
            gone = (*UNDER_WAY, WebhookDelivery.announced_at < moment - LEASE, WebhookDelivery.due_at <= moment)
            _set(session, gone, announced_at=None)
    with sessions() as session:
        moment = clock(session)
        tenants = list(session.scalars(_tenants_with_due(moment)))
        random.shuffle(tenants)
        chosen = [delivery_id for tenant in tenants[:TENANTS] for delivery_id in _next_of(session, tenant, moment)]
    if not chosen:  # the usual case, which takes no lock
        return []
    free = select(WebhookDelivery.id).where(WebhookDelivery.id.in_(chosen), *WAITING).with_for_update(skip_locked=True)
    announced = update(WebhookDelivery).where(WebhookDelivery.id.in_(free), *WAITING).values(announced_at=moment)
    with sessions.begin() as session:
        found = announced.returning(WebhookDelivery.id).execution_options(synchronize_session=False)
        return list(session.scalars(found))


def _tenants_with_due(moment: datetime) -> Select[str]:
    """Tenants with due deliveries; each tenant with waiting ones is two steps in the index."""
    first = select(func.min(WebhookDelivery.tenant_id).label("id")).where(*WAITING).cte("waiting", recursive=True)
    following = select(func.min(WebhookDelivery.tenant_id)).where(*WAITING, WebhookDelivery.tenant_id > first.c.id)
    tenants = first.union_all(select(following.scalar_subquery()).where(first.c.id.is_not(None)))
    due = exists().where(*WAITING, WebhookDelivery.tenant_id == tenants.c.id, WebhookDelivery.due_at <= moment)
    return select(tenants.c.id).where(tenants.c.id.is_not(None), due)


def _next_of(session: Session, tenant: str, moment: datetime) -> list[str]:
    """Next deliveries to announce for a tenant, which has no more than PER_TENANT under way."""
    mine = WebhookDelivery.tenant_id == tenant
    due = select(WebhookDelivery.id).where(mine, *WAITING, WebhookDelivery.due_at <= moment)
    first = due.order_by(WebhookDelivery.due_at).limit(PER_TENANT).subquery()
    # In one statement, so that no other process announces between two reads.
    both = union_all(
        select(WebhookDelivery.id, literal(True).label("under_way")).where(mine, *UNDER_WAY),
        select(first.c.id, literal(False)),
    )
    rows = session.execute(both).all()
    waiting = [row.id for row in rows if not row.under_way]
    return waiting[: max(0, PER_TENANT - (len(rows) - len(waiting)))]


def withdraw(sessions: Sessions, delivery_ids: list[str]) -> None:
    """Undo the announcement of deliveries whose messages could not be sent."""
    announced = update(WebhookDelivery).where(WebhookDelivery.id.in_(delivery_ids)).values(announced_at=None)
    with sessions.begin() as session:
        session.execute(announced.execution_options(synchronize_session=False))


def claim(sessions: Sessions, delivery_id: str) -> Claim | None:
    """Claim a delivery that is due, or None where it is not (or no longer) there to be claimed."""
    with sessions.begin() as session:
        moment = clock(session)
        due = (
            WebhookDelivery.id == delivery_id,
            WebhookDelivery.state == DeliveryState.PENDING,
            WebhookDelivery.due_at <= moment,
        )
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
            endpoint.tenant_id,
            delivery.url is None,
            url,
            secrets_of(endpoint, moment),
            Message.about(delivery.event),
            delivery.attempts + 1,
            moment,
        )


def put_back(sessions: Sessions, claim: Claim) -> None:
    """Release a claim without an attempt: the delivery is due again in a moment."""
    mine = (WebhookDelivery.id == claim.delivery_id, WebhookDelivery.token == claim.token)
    with sessions.begin() as session:
        _set(session, mine, due_at=clock(session) + PUT_BACK, announced_at=None)


def settle(sessions: Sessions, claim: Claim, outcome: Outcome) -> bool:
    """Record the outcome of an attempt; False when another process has claimed the delivery since.

    An endpoint that is gone is disabled, and its pending deliveries are given up; for a job's own webhook, only this.
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
        if gone:  # before the delivery, in the order of locks of a deletion of the endpoint
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
        erased = select(Job.id).join(WebhookDelivery, WebhookDelivery.job_id == Job.id).where(mine[0], Job.erased)
        if job_id := session.scalar(erased):
            erase_events(session, job_id)
        return True


def list_deliveries(
    sessions: Sessions, tenant: str, endpoint_id: str, state: DeliveryState | None, limit: int, cursor: str | None
) -> Page:
    """List an endpoint's newest deliveries, or those after a cursor, which is the id of the last one before.

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
    """Make a delivery due now, whatever its outcome was; it is the same message. Earlier attempts still count.

    Raises:
        MeshmarkError: ``not_found`` or ``endpoint_disabled``.
    """
    endpoint = find_endpoint(sessions, tenant, endpoint_id)
    if endpoint.disabled_reason:
        raise MeshmarkError(
            ServiceErrorCode.ENDPOINT_DISABLED,
            "The endpoint is disabled, so nothing is sent to it.",
            'Enable it first: PATCH it with {"disabled": false}.',
        )
    condition = (WebhookDelivery.id == delivery_id, WebhookDelivery.endpoint_id == endpoint_id)
    with sessions.begin() as session:
        values = {"state": DeliveryState.PENDING, "due_at": clock(session), "announced_at": None}
        if delivery_id.isprintable() and _set(session, condition, **values):
            return session.get_one(WebhookDelivery, delivery_id)
    raise MeshmarkError(
        ServiceErrorCode.NOT_FOUND,
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
