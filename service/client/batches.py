"""Many assets, a few at a time."""

import asyncio
from collections.abc import AsyncGenerator, Callable, Coroutine, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice
from typing import Generic, TypeVar

from service.client.orders import Source
from service.client.problems import MeshmarkProblem

AnyJob = TypeVar("AnyJob")


@dataclass(frozen=True)
class Outcome(Generic[AnyJob]):
    """Outcome for one asset: its job, which has succeeded, or an error."""

    asset: Source
    job: AnyJob | None = None
    error: MeshmarkProblem | OSError | None = None


def all_of(
    assets: Iterable[Source], do: Callable[[Source], AnyJob], concurrency: int
) -> Generator[Outcome[AnyJob], None, None]:
    """Outcomes in the order in which they come, of so many assets at a time in threads; no more are begun once nobody
    asks for the next one."""

    def outcome(asset: Source) -> Outcome[AnyJob]:
        try:
            return Outcome(asset, do(asset))
        except (MeshmarkProblem, OSError) as error:
            return Outcome(asset, error=error)

    left = iter(assets)
    with ThreadPoolExecutor(concurrency, "meshmark") as threads:
        running: set[Future[Outcome[AnyJob]]] = set()
        while True:
            running |= {threads.submit(outcome, asset) for asset in islice(left, concurrency - len(running))}
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            yield from (future.result() for future in done)


async def all_of_async(
    assets: Iterable[Source], do: Callable[[Source], Coroutine[None, None, AnyJob]], concurrency: int
) -> AsyncGenerator[Outcome[AnyJob], None]:
    """As :func:`all_of`, in tasks, which are canceled once nobody asks for the next outcome."""

    async def outcome(asset: Source) -> Outcome[AnyJob]:
        try:
            return Outcome(asset, await do(asset))
        except (MeshmarkProblem, OSError) as error:
            return Outcome(asset, error=error)

    left = iter(assets)
    running: set[asyncio.Task[Outcome[AnyJob]]] = set()
    try:
        while True:
            running |= {asyncio.create_task(outcome(asset)) for asset in islice(left, concurrency - len(running))}
            if not running:
                return
            done, running = await asyncio.wait(running, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                yield task.result()
    finally:
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)
