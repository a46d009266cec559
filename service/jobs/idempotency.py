"""Idempotency keys: one key, one job (draft-ietf-httpapi-idempotency-key-header).

A request first reserves its key, then records its job and settles the key in one transaction. A reservation holds for
seconds only, so that a killed process does not block the key for long; while the request is in progress it is renewed,
for a slow store may take its time. Its token keeps a request whose reservation has expired from recording a second job.
A request that fails releases its key.
"""

import hashlib
import json
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import Any, NamedTuple

import structlog
from sqlalchemy import delete, update
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session, sessionmaker

from core.errors import MeshmarkError
from service.background import in_background
from service.errors import ServiceErrorCode
from service.jobs.clock import clock
from service.jobs.database import insert_into
from service.jobs.models import IdempotencyKey

HELD, RENEWED = timedelta(seconds=15), 5.0  # lifetime of a reservation; seconds between two renewals
KEPT = timedelta(hours=24)  # retention of a key with its job

log = structlog.get_logger(__name__)


class Reservation(NamedTuple):
    """Right to record the job of a key. Every reservation has another token, so an old one records nothing."""

    tenant: str
    key: str
    token: str


def fingerprint(content: dict[str, Any]) -> str:
    """Fingerprint of a request: the SHA-256 of its content."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def reserve(sessions: sessionmaker[Session], tenant: str, key: str, print_: str) -> Reservation | str:
    """Reserve a key; returns the reservation, or the id of the job that the key has already.

    Raises:
        MeshmarkError: ``idempotency_key_reused``, the key is that of another request; ``idempotency_key_in_use``, a
            request with this key is being answered.
    """
    reservation = Reservation(tenant, key, str(uuid.uuid4()))
    with sessions.begin() as session:
        moment = clock(session)
        values = {"fingerprint": print_, "token": reservation.token, "job_id": None, "expires_at": moment + HELD}
        free = insert_into(session, IdempotencyKey).values(tenant_id=tenant, key=key, **values)
        free = free.on_conflict_do_update(
            index_elements=["tenant_id", "key"], set_=values, where=IdempotencyKey.expires_at < moment
        )
        if session.scalar(free.returning(IdempotencyKey.token)):
            return reservation
        taken = session.get(IdempotencyKey, (tenant, key))
    if taken is None:  # given back since
        raise _in_use()
    if taken.fingerprint != print_:
        raise MeshmarkError(
            ServiceErrorCode.IDEMPOTENCY_KEY_REUSED,
            "Another request was sent with this Idempotency-Key: its file, font, logo, parameters, metadata or webhook "
            "differ.",
            "Take a new key for each new request; send the same request again with the key that it had.",
        )
    if taken.job_id is None:
        raise _in_use()
    return taken.job_id


def settle(session: Session, reservation: Reservation, job_id: str) -> None:
    """Record the job of a key, in the transaction that records the job.

    Raises:
        MeshmarkError: ``idempotency_key_in_use``, the reservation was given to another request meanwhile.
    """
    values = {"job_id": job_id, "expires_at": clock(session) + KEPT}
    settled = update(IdempotencyKey).where(*_mine(reservation)).values(**values).returning(IdempotencyKey.token)
    if session.scalar(settled.execution_options(synchronize_session=False)) is None:
        raise _in_use()


@contextmanager
def holding(sessions: sessionmaker[Session], reservation: Reservation) -> Iterator[None]:
    """Renew a reservation during the block, and release its key at once if the block fails."""
    over = threading.Event()
    renewing = in_background("key", _renew_until, over, sessions, reservation)
    try:
        yield
    except BaseException:
        try:
            with sessions.begin() as session:
                session.execute(delete(IdempotencyKey).where(*_mine(reservation)))
        except OperationalError as error:
            log.warning("an idempotency key could not be given back; it will be free soon", error=str(error.orig))
        raise
    finally:
        over.set()
        renewing.join(RENEWED)  # a renewal that has begun ends before the caller goes on


def _renew_until(over: threading.Event, sessions: sessionmaker[Session], reservation: Reservation) -> None:
    while not over.wait(RENEWED):
        try:
            with sessions.begin() as session:
                renewed = update(IdempotencyKey).where(*_mine(reservation)).values(expires_at=clock(session) + HELD)
                session.execute(renewed.execution_options(synchronize_session=False))
        except OperationalError as error:
            log.warning("an idempotency key could not be renewed", error=str(error.orig))
        except Exception:
            log.exception("an idempotency key cannot be renewed")
            return


def forget(sessions: sessionmaker[Session]) -> None:
    """Delete expired keys."""
    with sessions.begin() as session:
        session.execute(delete(IdempotencyKey).where(IdempotencyKey.expires_at < clock(session)))


def _mine(reservation: Reservation) -> tuple[Any, ...]:
    return (
        IdempotencyKey.tenant_id == reservation.tenant,
        IdempotencyKey.key == reservation.key,
        IdempotencyKey.token == reservation.token,
        IdempotencyKey.job_id.is_(None),
    )


def _in_use() -> MeshmarkError:
    return MeshmarkError(
        ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE,
        "A request with this Idempotency-Key is being answered at this moment.",
        "Send the request again after the time in Retry-After; it then gets the answer of the first one.",
    )
