"""Plans: the work of a client, written once for both of them.

A plan is a generator that yields what a wire gives it, and is sent back the result: of a synchronous wire it is the
result already, of an asynchronous one something to be awaited. Errors come up where it yields.
"""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Generator, Iterator
from typing import Any, Protocol, TypeVar

import httpx2

Result = TypeVar("Result")
Plan = Generator[Any, Any, Result]


class Wire(Protocol):
    """Way of plans to the outside; `Any` is the result, or an awaitable of it."""

    @property
    def http(self) -> httpx2.Client | httpx2.AsyncClient:
        """Client of httpx2 whose requests are sent."""

    def send(self, request: httpx2.Request) -> Any:
        """Response, of which the body has not been read."""

    def read(self, response: httpx2.Response) -> Any:
        """Whole body of a response."""

    def close(self, response: httpx2.Response) -> Any:
        """End a response, read or not."""

    def chunks(self, response: httpx2.Response) -> Any:
        """Iterator over the body of a response, for `following`."""

    def events(self, response: httpx2.Response) -> Any:
        """Iterator over the server-sent events of a response, for `following`."""

    def following(self, iterator: Any) -> Any:
        """Next item of an iterator; None at its end."""

    def sleep(self, seconds: float) -> Any:
        """Pause."""

    def apart(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Result of work that may wait for a disk; errors come up as they are."""


class SyncWire:
    """Wire that waits in the caller's thread."""

    def __init__(self, http: httpx2.Client) -> None:
        self.http = http

    def send(self, request: httpx2.Request) -> httpx2.Response:
        """Response, of which the body has not been read."""
        return self.http.send(request, stream=True, follow_redirects=request.method == "GET")

    def read(self, response: httpx2.Response) -> bytes:
        """Whole body of a response."""
        return response.read()

    def close(self, response: httpx2.Response) -> None:
        """End a response, read or not."""
        response.close()

    def chunks(self, response: httpx2.Response) -> Iterator[bytes]:
        """Iterator over the body of a response."""
        return response.iter_bytes()

    def events(self, response: httpx2.Response) -> Iterator[httpx2.ServerSentEvent]:
        """Iterator over the server-sent events of a response."""
        return iter(httpx2.EventSource(response))

    def following(self, iterator: Iterator[Result]) -> Result | None:
        """Next item of an iterator; None at its end."""
        return next(iterator, None)

    def sleep(self, seconds: float) -> None:
        """Pause."""
        time.sleep(seconds)

    def apart(self, work: Callable[..., Result], *arguments: Any) -> Result:
        """Result of work that may wait for a disk."""
        return work(*arguments)


class _ReadApart(httpx2.AsyncByteStream):
    """Body of a request that is read in threads."""

    def __init__(self, body: httpx2.SyncByteStream) -> None:
        self._body = body

    async def __aiter__(self) -> AsyncIterator[bytes]:
        chunks = iter(self._body)
        while (chunk := await asyncio.to_thread(next, chunks, None)) is not None:
            yield chunk


class AsyncWire:
    """Wire whose results are awaited; files are read and written in threads."""

    def __init__(self, http: httpx2.AsyncClient) -> None:
        self.http = http

    def send(self, request: httpx2.Request) -> Awaitable[httpx2.Response]:
        """Response, of which the body has not been read."""
        if isinstance(request.stream, httpx2.SyncByteStream) and not isinstance(request.stream, httpx2.ByteStream):
            request.stream = _ReadApart(request.stream)
        return self.http.send(request, stream=True, follow_redirects=request.method == "GET")

    def read(self, response: httpx2.Response) -> Awaitable[bytes]:
        """Whole body of a response."""
        return response.aread()

    def close(self, response: httpx2.Response) -> Awaitable[None]:
        """End a response, read or not."""
        return response.aclose()

    def chunks(self, response: httpx2.Response) -> AsyncIterator[bytes]:
        """Iterator over the body of a response."""
        return response.aiter_bytes()

    def events(self, response: httpx2.Response) -> AsyncIterator[httpx2.ServerSentEvent]:
        """Iterator over the server-sent events of a response."""
        return aiter(httpx2.EventSource(response))

    def following(self, iterator: AsyncIterator[Result]) -> Awaitable[Result | None]:
        """Next item of an iterator; None at its end."""
        return anext(iterator, None)

    def sleep(self, seconds: float) -> Awaitable[None]:
        """Pause."""
        return asyncio.sleep(seconds)

    def apart(self, work: Callable[..., Result], *arguments: Any) -> Awaitable[Result]:
        """Result of work that may wait for a disk."""
        return asyncio.to_thread(work, *arguments)


def run(plan: Plan[Result]) -> Result:
    """Carry out a plan over a synchronous wire."""
    result: Any = None
    while True:
        try:
            result = plan.send(result)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]


async def run_async(plan: Plan[Result]) -> Result:
    """Carry out a plan over an asynchronous wire."""
    result: Any = None
    error: BaseException | None = None
    while True:
        try:
            awaited = plan.send(result) if error is None else plan.throw(error)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]
        try:
            result, error = await awaited, None
        except BaseException as raised:
            result, error = None, raised
