import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta

import pytest
from sqlalchemy import select

from core.errors import Code, MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs import idempotency
from service.jobs.idempotency import Reservation, fingerprint, forget, holding, reserve, settle
from service.jobs.ledger import Ledger, Submission
from service.jobs.models import IdempotencyKey
from tests.worker.waiting import wait_until

ONE, OTHER = fingerprint({"file": "1"}), fingerprint({"file": "2"})


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    ledger = Ledger(database_url)
    yield ledger
    ledger.close()


def reserved(ledger: Ledger, key: str = "a", tenant: str = "acme", print_: str = ONE) -> Reservation:
    reservation = reserve(ledger.sessions, tenant, key, print_)
    assert isinstance(reservation, Reservation)
    return reservation


def record(ledger: Ledger, reservation: Reservation) -> str:
    """The id of a job recorded for a key."""
    submission = Submission(reservation.tenant, condition=lambda session, job_id: settle(session, reservation, job_id))
    return ledger.create("asset.glb", {}, {}, lambda _: True, submission).id


def refusal(ledger: Ledger, key: str = "a", print_: str = ONE) -> Code:
    with pytest.raises(MeshmarkError) as refused:
        reserve(ledger.sessions, "acme", key, print_)
    return refused.value.code


def test_a_key_leads_to_the_job_that_was_recorded_for_it(ledger: Ledger) -> None:
    job_id = record(ledger, reserved(ledger))
    assert reserve(ledger.sessions, "acme", "a", ONE) == job_id
    assert ledger.get(job_id, "acme") is not None


def test_while_its_request_is_answered_a_key_is_in_use(ledger: Ledger) -> None:
    reserved(ledger)
    assert refusal(ledger) == ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE


def test_a_key_serves_one_request_only(ledger: Ledger) -> None:
    reservation = reserved(ledger)
    assert refusal(ledger, print_=OTHER) == ServiceErrorCode.IDEMPOTENCY_KEY_REUSED
    record(ledger, reservation)
    assert refusal(ledger, print_=OTHER) == ServiceErrorCode.IDEMPOTENCY_KEY_REUSED


def test_tenants_have_keys_of_their_own(ledger: Ledger) -> None:
    jobs = {record(ledger, reserved(ledger, tenant=tenant)) for tenant in ("acme", "beta")}
    assert len(jobs) == 2


def test_the_key_of_a_request_that_failed_is_free_again(ledger: Ledger) -> None:
    with pytest.raises(ZeroDivisionError), holding(ledger.sessions, reserved(ledger)):
        raise ZeroDivisionError
    record(ledger, reserved(ledger, print_=OTHER))


def test_what_fails_after_the_job_was_recorded_does_not_free_its_key(ledger: Ledger) -> None:
    reservation = reserved(ledger)
    job_id = record(ledger, reservation)
    with pytest.raises(ZeroDivisionError), holding(ledger.sessions, reservation):
        raise ZeroDivisionError
    assert reserve(ledger.sessions, "acme", "a", ONE) == job_id


def test_a_request_that_was_overtaken_records_nothing(ledger: Ledger, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(idempotency, "HELD", timedelta(seconds=0.05))
    slow = reserved(ledger)
    time.sleep(0.06)
    monkeypatch.undo()
    current = reserved(ledger)
    with pytest.raises(MeshmarkError) as refused, holding(ledger.sessions, slow):
        record(ledger, slow)
    assert refused.value.code == ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE
    assert refusal(ledger) == ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE, "the key is still the other request's"
    job_id = record(ledger, current)
    with pytest.raises(MeshmarkError) as refused, holding(ledger.sessions, slow):
        record(ledger, slow)
    assert refused.value.code == ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE
    assert ledger.waiting(-1) == [job_id]
    assert reserve(ledger.sessions, "acme", "a", ONE) == job_id


def expiry(ledger: Ledger) -> datetime:
    """The moment until which the only key is held."""
    with ledger.sessions() as session:
        return session.scalars(select(IdempotencyKey.expires_at)).one()


def test_a_request_that_takes_longer_than_a_reservation_holds_keeps_its_key(
    ledger: Ledger, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(idempotency, "RENEWED", 0.05)
    reservation = reserved(ledger)
    until = expiry(ledger)
    with holding(ledger.sessions, reservation):
        wait_until(lambda: expiry(ledger) > until + timedelta(seconds=0.2))
        assert refusal(ledger) == ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE
        record(ledger, reservation)


def test_of_many_requests_with_one_key_one_records_a_job(ledger: Ledger, database_url: str) -> None:
    ledgers = [ledger, Ledger(database_url)]  # as two processes have them

    def send(number: int) -> str | Code:
        mine = ledgers[number % 2]
        try:
            reservation = reserve(mine.sessions, "acme", f"key {number // 8}", ONE)
            return reservation if isinstance(reservation, str) else record(mine, reservation)
        except MeshmarkError as error:
            return error.code

    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(send, range(40)))
    ledgers[1].close()
    recorded = ledger.waiting(-1)
    assert len(recorded) == 5
    assert set(answers) - {ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE} == set(recorded)


def test_keys_are_forgotten_after_their_time_and_not_before(ledger: Ledger, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = record(ledger, reserved(ledger, "kept"))
    monkeypatch.setattr(idempotency, "KEPT", timedelta(seconds=0.05))
    old = record(ledger, reserved(ledger, "old"))
    time.sleep(0.06)
    assert isinstance(reserve(ledger.sessions, "acme", "old", OTHER), Reservation)
    monkeypatch.setattr(idempotency, "HELD", timedelta(seconds=0.01))
    reserved(ledger, "given up")
    time.sleep(0.02)
    forget(ledger.sessions)
    assert reserve(ledger.sessions, "acme", "kept", ONE) == kept
    with ledger.sessions() as session:
        left = session.scalars(select(IdempotencyKey.key)).all()
    assert set(left) == {"kept", "old"}
    assert ledger.get(old, "acme") is not None


def test_a_fingerprint_is_that_of_the_content_in_whatever_order() -> None:
    assert fingerprint({"a": 1, "b": [1]}) == fingerprint({"b": [1], "a": 1})
    assert fingerprint({"a": 1}) != fingerprint({"a": 2})
