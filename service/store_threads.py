"""The threads in which requests wait for the artifact store, beside those that answer all others.

A store that hangs holds these up, until it is given up after half a minute, and nothing else.
"""

import math
from collections.abc import AsyncIterator, Callable, Iterator
from functools import partial
from typing import TypeVar

from anyio import CapacityLimiter, fail_after, to_thread

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode

CONTENT = 32  # for uploads and downloads
DELETIONS = 8  # fewer than the connections to the ledger: whoever deletes holds one until the store has answered
PATIENCE = 30.0  # seconds until a thread is free

T = TypeVar("T")


class StoreThreads:
    """So many threads."""

    def __init__(self, number: int) -> None:
        self._places, self._threads = CapacityLimiter(number), CapacityLimiter(math.inf)

    async def run(self, work: Callable[[], T]) -> T:
        """What some work returns, which is done in one of them once one is free.

        Raises:
            MeshmarkError: ``service_unavailable``, none is free in time; and what the work raises.
        """
        place = object()
        try:
            with fail_after(PATIENCE):
                await self._places.acquire_on_behalf_of(place)
        except TimeoutError:
            raise MeshmarkError(
                ServiceErrorCode.SERVICE_UNAVAILABLE,
                "As many requests wait for the artifact store as may do so at a time.",
                "Send the request again in a few seconds; the operator can check the store.",
            ) from None
        try:
            return await to_thread.run_sync(work, limiter=self._threads)
        finally:
            self._places.release_on_behalf_of(place)

    async def each(self, chunks: Iterator[bytes]) -> AsyncIterator[bytes]:
        """The chunks of some content, each brought in one of them."""
        while (chunk := await self.run(partial(next, chunks, None))) is not None:
            yield chunk
