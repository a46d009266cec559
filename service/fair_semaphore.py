"""Fair semaphore: a limit on concurrent work, shared among tenants."""

import asyncio
import threading
from collections import Counter, deque
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import Future
from contextlib import asynccontextmanager, contextmanager

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode


class FairSemaphore:
    """Semaphore of which no tenant acquires more than three quarters, and none the last slot.

    A free slot goes to that waiting tenant below its limit which holds the fewest; of several such, to the one that has
    waited longest. So a newcomer finds a slot free, or gets the next one, however many requests others have.

    Args:
        count: number of slots.
    """

    def __init__(self, count: int) -> None:
        self._free = count
        self._most = max(1, count - max(1, count // 4))  # of a tenant
        self._held = Counter[str]()
        self._waiting: dict[str, deque[tuple[int, Future[None]]]] = {}
        self._requests = 0
        self._open = True
        self._lock = threading.Lock()

    @contextmanager
    def acquired(self, tenant: str) -> Iterator[None]:
        """Acquire a slot for the block; the thread waits.

        Raises:
            MeshmarkError: ``service_unavailable``, the service stops.
        """
        self._request(tenant).result()
        try:
            yield
        finally:
            self._release(tenant)

    @asynccontextmanager
    async def acquired_async(self, tenant: str) -> AsyncIterator[None]:
        """Acquire a slot for the block; the coroutine waits, and no thread."""
        grant = self._request(tenant)
        try:
            await asyncio.wrap_future(grant)
        except asyncio.CancelledError:
            if not grant.cancel():  # it was granted at the same moment
                self._release(tenant)
            raise
        try:
            yield
        finally:
            self._release(tenant)

    def close(self) -> None:
        """Refuse all waiting and new requests."""
        with self._lock:
            self._open = False
            waiting = [grant for queue in self._waiting.values() for _, grant in queue]
            self._waiting.clear()
        for grant in waiting:
            if grant.set_running_or_notify_cancel():
                grant.set_exception(_closed())

    def _request(self, tenant: str) -> Future[None]:
        grant = Future[None]()
        with self._lock:
            if not self._open:
                raise _closed()
            self._requests += 1
            self._waiting.setdefault(tenant, deque()).append((self._requests, grant))
        self._grant()
        return grant

    def _release(self, tenant: str) -> None:
        with self._lock:
            self._free += 1
            self._held[tenant] -= 1
            if not self._held[tenant]:
                del self._held[tenant]
        self._grant()

    def _grant(self) -> None:
        """Grant free slots to the tenants that are next."""
        while True:
            with self._lock:
                able = [tenant for tenant in self._waiting if self._held[tenant] < self._most]
                if not self._free or not able:
                    return
                tenant = min(able, key=lambda each: (self._held[each], self._waiting[each][0][0]))
                _, grant = self._waiting[tenant].popleft()
                if not self._waiting[tenant]:
                    del self._waiting[tenant]
                if not grant.set_running_or_notify_cancel():  # the request was canceled
                    continue
                self._free -= 1
                self._held[tenant] += 1
            grant.set_result(None)


def _closed() -> MeshmarkError:
    return MeshmarkError(
        ServiceErrorCode.SERVICE_UNAVAILABLE,
        "The service is about to stop.",
        "Send the request again in a few seconds.",
    )
