"""Slots are shared fairly: nobody waits behind all that another tenant asks for."""

import asyncio
import contextlib
import threading
from contextlib import ExitStack

import pytest

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.fair_semaphore import FairSemaphore
from tests.worker.waiting import PATIENCE


class Crowd:
    """Threads that each want a place and leave it when they are told to; who has come in, in this order."""

    def __init__(self, semaphore: FairSemaphore) -> None:
        self.semaphore = semaphore
        self.entered: list[str] = []
        self.done: dict[str, threading.Event] = {}
        self.threads: list[threading.Thread] = []
        self.changed = threading.Condition()

    def come(self, name: str) -> None:
        """The first letter of the name is the tenant."""
        self.done[name] = threading.Event()
        asked = threading.Event()

        def stay() -> None:
            with ExitStack() as stack:
                place = self.semaphore._request(name[0])
                asked.set()
                place.result(PATIENCE)
                stack.callback(self.semaphore._release, name[0])
                with self.changed:
                    self.entered.append(name)
                    self.changed.notify_all()
                self.done[name].wait(PATIENCE)

        self.threads.append(threading.Thread(target=stay))
        self.threads[-1].start()
        asked.wait(PATIENCE)

    def expect(self, *names: str) -> None:
        """These are in, or have been, and nobody else."""
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.entered) >= len(names), PATIENCE)
            assert sorted(self.entered) == sorted(names)

    def go(self, name: str) -> None:
        self.done[name].set()

    def end(self) -> None:
        for event in self.done.values():
            event.set()
        for thread in self.threads:
            thread.join(PATIENCE)


def test_a_tenant_who_asks_for_everything_leaves_a_place_to_the_next_one() -> None:
    crowd = Crowd(FairSemaphore(4))
    for number in range(10):
        crowd.come(f"a{number}")
    crowd.expect("a0", "a1", "a2")
    crowd.come("b0")
    crowd.expect("a0", "a1", "a2", "b0")
    crowd.end()
    assert len(crowd.entered) == 11


def test_whoever_has_the_fewest_places_gets_the_next_one_and_of_those_who_waited_longest() -> None:
    crowd = Crowd(FairSemaphore(2))
    for name in ("a0", "b0"):
        crowd.come(name)
    crowd.expect("a0", "b0")
    for name in ("a1", "a2", "c0", "d0", "c1"):
        crowd.come(name)
    crowd.go("b0")
    crowd.expect("a0", "b0", "c0")
    crowd.go("c0")
    crowd.expect("a0", "b0", "c0", "d0")
    crowd.go("d0")
    crowd.expect("a0", "b0", "c0", "d0", "c1")
    crowd.end()


def test_of_one_place_tenants_take_turns() -> None:
    crowd = Crowd(FairSemaphore(1))
    for name in ("a0", "a1", "b0"):
        crowd.come(name)
    crowd.expect("a0")
    crowd.go("a0")
    crowd.expect("a0", "a1")
    crowd.end()
    assert crowd.entered == ["a0", "a1", "b0"]


def test_whoever_goes_away_while_waiting_takes_no_place() -> None:
    async def stay(semaphore: FairSemaphore, tenant: str, entered: list[str]) -> None:
        async with semaphore.acquired_async(tenant):
            entered.append(tenant)
            await asyncio.sleep(0)

    async def run() -> list[str]:
        semaphore, entered = FairSemaphore(1), list[str]()
        async with semaphore.acquired_async("a"):
            waiting = [asyncio.create_task(stay(semaphore, tenant, entered)) for tenant in ("b", "c", "d")]
            await asyncio.sleep(0)
            waiting[0].cancel()
            waiting[2].cancel()
        for task in waiting:
            with contextlib.suppress(asyncio.CancelledError):
                await task
        async with semaphore.acquired_async("e"):
            pass
        return entered

    assert asyncio.run(run()) == ["c"]


def test_nobody_waits_for_a_service_that_stops() -> None:
    async def run() -> list[BaseException | None]:
        semaphore = FairSemaphore(1)

        async def stay() -> None:
            async with semaphore.acquired_async("b"):
                pass

        async with semaphore.acquired_async("a"):
            waiting = asyncio.create_task(stay())
            await asyncio.sleep(0)
            semaphore.close()
            results = await asyncio.gather(waiting, stay(), return_exceptions=True)
        return list(results)

    for error in asyncio.run(run()):
        assert isinstance(error, MeshmarkError)
        assert error.code is ServiceErrorCode.SERVICE_UNAVAILABLE


def test_the_place_is_given_back_whatever_happens_in_it() -> None:
    semaphore = FairSemaphore(1)
    with pytest.raises(ZeroDivisionError), semaphore.acquired("a"):
        raise ZeroDivisionError
    with semaphore.acquired("a"):
        pass
