"""Thread pools in which requests wait for the artifact store, beside the threads of all other requests.

A store that hangs holds these threads up, until its requests time out after half a minute, and nothing else.
"""

import math
from collections.abc import AsyncIterator, Callable, Iterator
from functools import partial
from typing import TypeVar

from anyio import CapacityLimiter, fail_after, to_thread

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode

CONTENT = 32  # threads for uploads and downloads
DELETIONS = 8  # threads; fewer than connections to the ledger: a deletion holds one until the store answers
TIMEOUT = 30.0  # seconds to wait for a free thread

T = TypeVar("T")


class StoreThreads:
    """Thread pool of a fixed size."""

    def __init__(self, number: int) -> None:
        self._places, self._threads = CapacityLimiter(number), CapacityLimiter(math.inf)

    async def run(self, work: Callable[[], T]) -> T:
        """Run work in a thread of the pool once one is free; returns its result.

        Raises:
            MeshmarkError: ``service_unavailable``, none is free in time; and what the work raises.
        """
        place = object()
        try:
            with fail_after(TIMEOUT):
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
        """Chunks of some content, each read in a thread of the pool."""
        while (chunk := await self.run(partial(next, chunks, None))) is not None:
            yield chunk
