from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta
from typing import Any

import pytest
from sqlalchemy import update

from core.errors import MeshmarkError
from service.jobs.clock import now
from service.jobs.events import ENDINGS, forget
from service.jobs.ledger import Ledger, Submission
from service.jobs.models import DeliveryState, DisabledReason, WebhookDelivery, WebhookEndpoint
from service.webhooks import deliveries
from service.webhooks.deliver import Outcome, Result
from service.webhooks.deliveries import announce, claim, list_deliveries, redeliver, settle
from service.webhooks.endpoints import change_endpoint, create_endpoint, delete_endpoint, find_endpoint, rotate_secret

URL = "https://shop.example/hook"
TENANT = "default"
GOOD = Outcome(Result.DELIVERED, 200, None, "thank you", 0.1, None)
GONE = Outcome(Result.ENDPOINT_GONE, 410, None, "", 0.1, None)


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    ledger = Ledger(database_url)
    yield ledger
    ledger.close()


def endpoint(ledger: Ledger, url: str | None = URL, tenant: str = TENANT, events: Any = ENDINGS) -> WebhookEndpoint:
    return create_endpoint(ledger.sessions, tenant, url, events, None)


def ended_job(ledger: Ledger, tenant: str = TENANT, webhook: str | None = None) -> str:
    job_id = ledger.create("asset.glb", {}, {}, lambda _: True, Submission(tenant, webhook=webhook)).id
    assert ledger.cancel(job_id, tenant)
    return job_id


def log(ledger: Ledger, endpoint: WebhookEndpoint) -> list[WebhookDelivery]:
    return list_deliveries(ledger.sessions, endpoint.tenant_id, endpoint.id, None, 100, None).deliveries


def only(ledger: Ledger, endpoint: WebhookEndpoint) -> WebhookDelivery:
    [delivery] = log(ledger, endpoint)
    return delivery


def taken(ledger: Ledger, delivery_id: str) -> deliveries.Claim:
    claimed = claim(ledger.sessions, delivery_id)
    assert claimed is not None
    return claimed


def failed(retry_at: datetime) -> Outcome:
    return Outcome(Result.RETRY, 500, None, "no", 0.1, retry_at)


def set_back(ledger: Ledger, **values: datetime) -> None:
    with ledger.sessions.begin() as session:
        session.execute(update(WebhookDelivery).values(**values))


def test_a_job_that_ends_is_told_to_each_endpoint_that_wants_it_and_to_its_own(ledger: Ledger) -> None:
    both, failures, own, theirs = (
        endpoint(ledger),
        endpoint(ledger, events=["watermark.failed"]),
        endpoint(ledger, None),
        endpoint(ledger, tenant="acme"),
    )
    job_id = ended_job(ledger, webhook="https://shop.example/4711")
    ended_job(ledger)
    assert [len(log(ledger, item)) for item in (both, failures, own, theirs)] == [2, 0, 1, 0]
    special = taken(ledger, only(ledger, own).id)
    assert special.url == "https://shop.example/4711"
    assert special.secrets == [own.secret]
    general = taken(ledger, log(ledger, both)[-1].id)
    assert (general.url, general.secrets) == (URL, [both.secret])
    assert general.message == special.message
    assert job_id.replace("-", "") in general.message.id


def test_what_is_due_is_announced_once(ledger: Ledger) -> None:
    endpoint(ledger)
    for _ in range(5):
        ended_job(ledger)
    with ThreadPoolExecutor(4) as pool:
        found = [item for some in pool.map(lambda _: announce(ledger.sessions, lost=True), range(4)) for item in some]
    assert len(found) == len(set(found)) == 5


def test_what_could_not_be_announced_is_announced_by_the_next(ledger: Ledger) -> None:
    endpoint(ledger)
    ended_job(ledger)
    found = announce(ledger.sessions, lost=False)
    deliveries.withdraw(ledger.sessions, found)
    assert announce(ledger.sessions, lost=False) == found


def test_of_many_processes_one_makes_the_attempt(ledger: Ledger) -> None:
    hook = endpoint(ledger)
    ended_job(ledger)
    delivery = only(ledger, hook)
    with ThreadPoolExecutor(8) as pool:
        claims = [item for item in pool.map(lambda _: claim(ledger.sessions, delivery.id), range(8)) if item]
    assert len(claims) == 1
    assert settle(ledger.sessions, claims[0], GOOD)
    done = only(ledger, hook)
    assert (done.state, done.attempts, done.due_at) == (DeliveryState.DELIVERED, 1, None)
    assert [(item.number, item.status, item.snippet) for item in done.log] == [(1, 200, "thank you")]
    assert claim(ledger.sessions, delivery.id) is None
    assert announce(ledger.sessions, lost=True) == []


def test_an_attempt_that_failed_is_repeated_when_it_is_due_and_not_before(ledger: Ledger) -> None:
    hook = endpoint(ledger)
    ended_job(ledger)
    [delivery_id] = announce(ledger.sessions, lost=False)
    first = taken(ledger, delivery_id)
    assert settle(ledger.sessions, first, failed(now() + timedelta(hours=1)))
    assert announce(ledger.sessions, lost=True) == []
    assert claim(ledger.sessions, delivery_id) is None
    set_back(ledger, due_at=now() - timedelta(seconds=1))
    assert announce(ledger.sessions, lost=False) == [delivery_id]
    second = taken(ledger, delivery_id)
    assert (second.attempt, second.message) == (2, first.message)
    settle(ledger.sessions, second, GOOD)
    assert [item.status for item in only(ledger, hook).log] == [500, 200]


def test_a_rotation_holds_for_messages_that_wait_already(ledger: Ledger) -> None:
    hook = endpoint(ledger)
    ended_job(ledger)
    rotated = rotate_secret(ledger.sessions, TENANT, hook.id, None)
    assert taken(ledger, only(ledger, hook).id).secrets == [rotated.secret, hook.secret]


def test_what_a_killed_process_had_claimed_is_sent_by_another_and_the_first_records_nothing(ledger: Ledger) -> None:
    hook = endpoint(ledger)
    ended_job(ledger)
    [delivery_id] = announce(ledger.sessions, lost=False)
    lost = taken(ledger, delivery_id)
    assert announce(ledger.sessions, lost=True) == []
    set_back(ledger, due_at=now() - timedelta(seconds=1), announced_at=now() - deliveries.LEASE * 1.1)
    assert announce(ledger.sessions, lost=False) == []
    assert announce(ledger.sessions, lost=True) == [delivery_id]
    again = taken(ledger, delivery_id)
    assert (again.attempt, again.message) == (1, lost.message)
    assert not settle(ledger.sessions, lost, GOOD)
    assert settle(ledger.sessions, again, failed(now()))
    assert only(ledger, hook).state == DeliveryState.PENDING


def test_an_endpoint_that_is_gone_is_disabled_with_all_that_waits_for_it(ledger: Ledger) -> None:
    hook, other = endpoint(ledger), endpoint(ledger, URL + "/other")
    ended_job(ledger)
    ended_job(ledger)
    settle(ledger.sessions, taken(ledger, log(ledger, hook)[0].id), GONE)
    assert find_endpoint(ledger.sessions, TENANT, hook.id).disabled_reason is DisabledReason.GONE
    assert [item.state for item in log(ledger, hook)] == [DeliveryState.EXHAUSTED] * 2
    ended_job(ledger)
    assert (len(log(ledger, hook)), len(log(ledger, other))) == (2, 3)
    assert {item.state for item in log(ledger, other)} == {DeliveryState.PENDING}


def test_a_jobs_own_webhook_that_is_gone_ends_for_this_job_alone(ledger: Ledger) -> None:
    own = endpoint(ledger, None)
    for number in range(2):
        ended_job(ledger, webhook=f"{URL}/{number}")
    settle(ledger.sessions, taken(ledger, log(ledger, own)[0].id), GONE)
    assert sorted(item.state for item in log(ledger, own)) == [DeliveryState.EXHAUSTED, DeliveryState.PENDING]
    assert find_endpoint(ledger.sessions, TENANT, own.id).disabled_reason is None


def test_a_disabled_endpoint_is_sent_nothing_until_it_is_enabled_and_asked_for(ledger: Ledger) -> None:
    hook = endpoint(ledger)
    ended_job(ledger)
    delivery = only(ledger, hook)
    change_endpoint(ledger.sessions, TENANT, hook.id, None, None, disabled=True)
    assert claim(ledger.sessions, delivery.id) is None
    assert only(ledger, hook).state == DeliveryState.EXHAUSTED
    with pytest.raises(MeshmarkError, match="endpoint_disabled"):
        redeliver(ledger.sessions, TENANT, hook.id, delivery.id)
    set_back(ledger, due_at=now())  # one that was noted at the moment of disabling
    with ledger.sessions.begin() as session:
        session.execute(update(WebhookDelivery).values(state=DeliveryState.PENDING))
    assert claim(ledger.sessions, delivery.id) is None
    assert only(ledger, hook).state == DeliveryState.EXHAUSTED
    change_endpoint(ledger.sessions, TENANT, hook.id, None, None, disabled=False)
    assert redeliver(ledger.sessions, TENANT, hook.id, delivery.id).state == DeliveryState.PENDING
    assert announce(ledger.sessions, lost=False) == [delivery.id]
    assert claim(ledger.sessions, delivery.id) is not None


def test_a_redelivery_is_the_same_message_and_its_attempt_counts_on(ledger: Ledger) -> None:
    hook = endpoint(ledger)
    ended_job(ledger)
    first = taken(ledger, only(ledger, hook).id)
    settle(ledger.sessions, first, GOOD)
    redeliver(ledger.sessions, TENANT, hook.id, first.delivery_id)
    second = taken(ledger, first.delivery_id)
    assert (second.attempt, second.message) == (2, first.message)
    settle(ledger.sessions, second, GOOD)
    assert len(only(ledger, hook).log) == 2


def test_what_is_not_the_tenants_or_not_the_endpoints_is_not_there(ledger: Ledger) -> None:
    hook, other = endpoint(ledger), endpoint(ledger)
    ended_job(ledger)
    delivery_id = only(ledger, hook).id
    for tenant, endpoint_id, wanted in (
        ("acme", hook.id, delivery_id),
        (TENANT, other.id, delivery_id),
        (TENANT, hook.id, "0" * 36),
        (TENANT, hook.id, "\x00"),
    ):
        with pytest.raises(MeshmarkError, match="not_found"):
            redeliver(ledger.sessions, tenant, endpoint_id, wanted)
    with pytest.raises(MeshmarkError, match="not_found"):
        list_deliveries(ledger.sessions, "acme", hook.id, None, 10, None)
    for cursor in (delivery_id, "x", "\x00"):
        with pytest.raises(MeshmarkError, match="invalid_request"):
            list_deliveries(ledger.sessions, TENANT, other.id, None, 10, cursor)


def test_one_tenants_flood_does_not_hold_up_anothers_message(ledger: Ledger) -> None:
    flood, other = endpoint(ledger), endpoint(ledger, tenant="acme")
    for _ in range(deliveries.PER_TENANT + 4):
        ended_job(ledger)
    ended_job(ledger, "acme")
    found = announce(ledger.sessions, lost=False)
    assert only(ledger, other).id in found
    assert len(found) == deliveries.PER_TENANT + 1
    assert announce(ledger.sessions, lost=False) == []
    for delivery_id in [item for item in found if item != only(ledger, other).id][:2]:
        claimed = taken(ledger, delivery_id)
        assert announce(ledger.sessions, lost=False) == [], "what is being sent has its place"
        settle(ledger.sessions, claimed, GOOD)
        [following] = announce(ledger.sessions, lost=False)
        assert following not in found
    assert len(log(ledger, flood)) == deliveries.PER_TENANT + 4


def test_the_log_is_paged_and_filtered(ledger: Ledger) -> None:
    hook = endpoint(ledger)
    for _ in range(5):
        ended_job(ledger)
    settle(ledger.sessions, taken(ledger, log(ledger, hook)[2].id), GOOD)
    seen, cursor = [], None
    for _ in range(3):
        page = list_deliveries(ledger.sessions, TENANT, hook.id, None, 2, cursor)
        seen += [item.id for item in page.deliveries]
        cursor = page.cursor
    assert cursor is None
    assert seen == [item.id for item in log(ledger, hook)]
    assert len(seen) == 5
    states = Counter(item.state for item in log(ledger, hook))
    for state in DeliveryState:
        page = list_deliveries(ledger.sessions, TENANT, hook.id, state, 10, None)
        assert len(page.deliveries) == states[state]


def test_the_log_goes_with_its_endpoint_and_with_the_events(ledger: Ledger) -> None:
    hook, other = endpoint(ledger), endpoint(ledger)
    ended_job(ledger)
    for item in (hook, other):
        settle(ledger.sessions, taken(ledger, only(ledger, item).id), GOOD)
    delete_endpoint(ledger.sessions, TENANT, hook.id)
    assert len(log(ledger, other)) == 1
    forget(ledger.sessions, now() + timedelta(seconds=1))
    assert log(ledger, other) == []
    with pytest.raises(MeshmarkError, match="not_found"):
        log(ledger, hook)


def test_what_was_taken_away_during_an_attempt_is_not_an_error(ledger: Ledger) -> None:
    hook = endpoint(ledger)
    ended_job(ledger)
    claimed = taken(ledger, only(ledger, hook).id)
    delete_endpoint(ledger.sessions, TENANT, hook.id)
    assert not settle(ledger.sessions, claimed, GOOD)
    assert not settle(ledger.sessions, claimed, GONE)
