import threading
from contextlib import ExitStack
from pathlib import Path

import pytest
from sqlalchemy import select

from service.config import Settings
from service.jobs.events import ENDINGS
from service.jobs.ledger import Submission
from service.jobs.models import WebhookDelivery
from service.jobs.queue import create_queue
from service.webhooks import deliveries
from service.webhooks.endpoints import create_endpoint
from service.webhooks.signing import new_secret
from service.webhooks.slots import Slots
from tests.service.harness import free_port
from tests.service.webhooks.receiver import Receiver
from tests.worker.waiting import PATIENCE, wait_until
from worker.webhooks import CONCURRENCY, Sender


@pytest.mark.parametrize("hogs", [1, 2, 3, 7, 31])
def test_however_many_tenants_take_all_they_can_there_is_a_place_for_the_next(hogs: int) -> None:
    slots = Slots(32)
    held = {f"hog {number}": 0 for number in range(hogs)}
    while taking := [tenant for tenant in held if slots.acquire(tenant)]:
        for tenant in taking:
            held[tenant] += 1
    assert max(held.values()) - min(held.values()) <= 1
    assert max(held.values()) <= 32 / (hogs + 1) + 1
    assert slots.acquire("next")
    slots.release("next")
    for tenant, number in held.items():
        for _ in range(number):
            slots.release(tenant)
    assert sum(slots.acquire("one") for _ in range(32)) == 16


def test_two_tenants_with_silent_receivers_do_not_hold_up_a_third(tmp_path: Path) -> None:
    tenants = ("slow", "slower", "quick")
    receivers = {tenant: Receiver(free_port(), secret=new_secret()) for tenant in tenants}
    ports = ",".join(str(receiver.port) for receiver in receivers.values())
    outbound = {"outbound_networks": "127.0.0.0/8", "outbound_http": True, "outbound_ports": ports}
    settings = Settings(data_dir=tmp_path, **outbound)  # type: ignore[arg-type]
    with create_queue(settings) as broker, ExitStack() as stack:
        sender = Sender(settings, broker)
        ledger = sender.ledger
        for tenant, receiver in receivers.items():
            stack.enter_context(receiver.running())
            create_endpoint(ledger.sessions, tenant, receiver.url, ENDINGS, receiver.secret)
            for _ in range(1 if tenant == "quick" else CONCURRENCY):
                ledger.cancel(ledger.create("a.glb", {}, {}, lambda _: True, Submission(tenant)).id, tenant)
        for tenant in tenants[:2]:
            receivers[tenant].silent.set()
        with ledger.sessions() as session:
            rows = session.execute(select(WebhookDelivery.id, WebhookDelivery.tenant_id)).all()
        slow = [row.id for row in rows if row.tenant_id != "quick"]
        threads = [threading.Thread(target=sender.send, args=(delivery_id,)) for delivery_id in slow]
        for thread in threads:
            thread.start()
        wait_until(lambda: sum(thread.is_alive() for thread in threads) < CONCURRENCY)
        wait_until(lambda: len(receivers["slow"].ids) + len(receivers["slower"].ids) >= CONCURRENCY // 2)
        assert sum(thread.is_alive() for thread in threads) < CONCURRENCY
        [quick] = [row.id for row in rows if row.tenant_id == "quick"]
        sender.send(quick)
        assert len(receivers["quick"].believed) == 1
        for tenant in tenants[:2]:
            receivers[tenant].silent.clear()
        for thread in threads:
            thread.join(PATIENCE)
        with ledger.sessions() as session:
            left = session.scalars(select(WebhookDelivery).where(WebhookDelivery.state == "pending")).unique().all()
        assert left, "those for which there was no place"
        assert {(item.attempts, item.announced_at) for item in left} == {(0, None)}
        wait_until(lambda: len(deliveries.announce(ledger.sessions, lost=False)) > 0)
        ledger.close()
