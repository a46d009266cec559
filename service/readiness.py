"""Readiness of the servers behind the API: ledger, broker and artifact store."""

import asyncio
import time
from collections.abc import Callable, Mapping

import structlog

TIMEOUT = 3.0  # seconds a part has to answer
CACHED = 1.0  # seconds an answer is cached: anybody may ask, and no part shall be probed more often

log = structlog.get_logger(__name__)


class Readiness:
    """Probes all parts concurrently, and each at most once at a time.

    A part that hangs holds one thread, however often it is probed.

    Args:
        parts: probes by name, which raise if the part does not work.
    """

    def __init__(self, parts: Mapping[str, Callable[[], object]]) -> None:
        self._parts = parts
        self._looking = asyncio.Lock()
        self._asked: dict[str, asyncio.Task[bool]] = {}
        self._failing: list[str] = []
        self._seen = float("-inf")

    async def failing(self) -> list[str]:
        """Names of the parts that do not answer, or not in time; as of the last second."""
        async with self._looking:
            if time.monotonic() > self._seen + CACHED:
                self._failing = await self._look()
                self._seen = time.monotonic()
        return self._failing

    async def _look(self) -> list[str]:
        for name in self._parts.keys() - self._asked.keys():
            # Threads of their own: those that answer requests may all be waiting for a part that hangs.
            self._asked[name] = asyncio.create_task(asyncio.to_thread(_answers, name, self._parts[name]))
        done, late = await asyncio.wait(self._asked.values(), timeout=TIMEOUT)
        failing = [name for name in self._parts if (task := self._asked[name]) in late or not task.result()]
        self._asked = {name: task for name, task in self._asked.items() if task not in done}
        return failing


def _answers(name: str, part: Callable[[], object]) -> bool:
    try:
        part()
    except BaseException as error:  # a panic too: it would else be raised again at every probe
        log.error("not ready", part=name, error=str(error) or type(error).__name__)
        return False
    return True
