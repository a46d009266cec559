"""Places for what is done at the same time, shared fairly among tenants."""

import asyncio
import threading
from collections import Counter, deque
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import Future
from contextlib import asynccontextmanager, contextmanager

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode


class Turnstile:
    """A number of places, of which no tenant has more than three quarters, and none has the last.

    A place that is free goes to that tenant, of those who wait and may have one more, who has the fewest; of several
    such to the one who has waited longest. So whoever comes finds a place free, or gets the next one, however much
    others ask for.

    Args:
        count: how many there are.
    """

    def __init__(self, count: int) -> None:
        self._free = count
        self._most = max(1, count - max(1, count // 4))  # of a tenant
        self._held = Counter[str]()
        self._waiting: dict[str, deque[tuple[int, Future[None]]]] = {}
        self._asked = 0
        self._open = True
        self._lock = threading.Lock()

    @contextmanager
    def taken(self, tenant: str) -> Iterator[None]:
        """Wait for a place, in a thread, and hold it.

        Raises:
            MeshmarkError: ``service_unavailable``, the service stops.
        """
        self._ask(tenant).result()
        try:
            yield
        finally:
            self._leave(tenant)

    @asynccontextmanager
    async def entered(self, tenant: str) -> AsyncIterator[None]:
        """As :meth:`taken`, in a coroutine: no thread waits."""
        place = self._ask(tenant)
        try:
            await asyncio.wrap_future(place)
        except asyncio.CancelledError:
            if not place.cancel():  # it came at the same moment
                self._leave(tenant)
            raise
        try:
            yield
        finally:
            self._leave(tenant)

    def close(self) -> None:
        """Let nobody wait any more."""
        with self._lock:
            self._open = False
            waiting = [place for places in self._waiting.values() for _, place in places]
            self._waiting.clear()
        for place in waiting:
            if place.set_running_or_notify_cancel():
                place.set_exception(_closed())

    def _ask(self, tenant: str) -> Future[None]:
        place = Future[None]()
        with self._lock:
            if not self._open:
                raise _closed()
            self._asked += 1
            self._waiting.setdefault(tenant, deque()).append((self._asked, place))
        self._give()
        return place

    def _leave(self, tenant: str) -> None:
        with self._lock:
            self._free += 1
            self._held[tenant] -= 1
            if not self._held[tenant]:
                del self._held[tenant]
        self._give()

    def _give(self) -> None:
        """Give what is free to those whose turn it is."""
        while True:
            with self._lock:
                able = [tenant for tenant in self._waiting if self._held[tenant] < self._most]
                if not self._free or not able:
                    return
                tenant = min(able, key=lambda each: (self._held[each], self._waiting[each][0][0]))
                _, place = self._waiting[tenant].popleft()
                if not self._waiting[tenant]:
                    del self._waiting[tenant]
                if not place.set_running_or_notify_cancel():  # whoever asked has gone
                    continue
                self._free -= 1
                self._held[tenant] += 1
            place.set_result(None)


def _closed() -> MeshmarkError:
    return MeshmarkError(
        ServiceErrorCode.SERVICE_UNAVAILABLE,
        "The service is about to stop.",
        "Send the request again in a few seconds.",
    )
