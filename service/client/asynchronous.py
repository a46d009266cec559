"""The asynchronous client: as :mod:`service.client.synchronous`, awaited."""

import json
import os
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Iterable, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self, Unpack

import httpx2

from service.client.batches import Outcome, all_of_async
from service.client.exchange import Exchange
from service.client.jobs import JobFacts
from service.client.operations import Kind, Listed, Operations, filters_of, headers_of, job_path
from service.client.orders import (
    BatchItem,
    Copy,
    File,
    Form,
    Order,
    Sending,
    Source,
    UploadId,
    conversion_form,
    verification_form,
    watermark_form,
)
from service.client.plans import AsyncWire, run_async
from service.client.problems import MeshmarkProblem

OnProgress = Callable[["AsyncJob"], object]


class AsyncJob(JobFacts):
    """Job of a client, with what can be done with it."""

    def __init__(self, facts: dict[str, Any], operations: Operations) -> None:
        super().__init__(facts)
        self._do = operations

    async def wait(self, on_progress: OnProgress | None = None) -> Self:
        """As :meth:`service.client.Job.wait`."""
        await run_async(self._do.follow(self, lambda: on_progress(self) if on_progress else None))
        return self

    async def result(self, on_progress: OnProgress | None = None) -> Self:
        """As :meth:`service.client.Job.result`."""
        await self.wait(on_progress)
        if problem := self.problem:
            raise problem
        return self

    async def refresh(self) -> Self:
        """As :meth:`service.client.Job.refresh`."""
        self.facts = await run_async(self._do.read(self.place))
        return self

    async def download(self, path: str | os.PathLike[str], part: str | None = None) -> Path:
        """As :meth:`service.client.Job.download`."""
        return await run_async(self._do.save(self.path_of(part), path))

    async def content(self, part: str | None = None) -> bytes:
        """As :meth:`service.client.Job.content`."""
        return await run_async(self._do.content(self.path_of(part)))

    async def report(self) -> dict[str, Any]:
        """As :meth:`service.client.Job.report`."""
        return dict(json.loads(await self.content("report")))

    async def preview(self) -> bytes:
        """As :meth:`service.client.Job.preview`."""
        return await self.content("preview")

    async def delete(self) -> None:
        """As :meth:`service.client.Job.delete`."""
        await run_async(self._do.delete(self.place))


class AsyncClient:
    """Client of a service. Close it, or use it in an `async with` block.

    Args:
        url: of the service.
        key: API key, `mm_...`, where one is needed.
        timeout: seconds without a byte after which an answer is given up.
        retries: how often a request that may be repeated is sent again at most.
        transport: of httpx2, for proxies or certificates of your own.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8080",
        key: str | None = None,
        *,
        timeout: float = 60.0,
        retries: int = 5,
        transport: httpx2.AsyncBaseTransport | None = None,
    ) -> None:
        self._http = httpx2.AsyncClient(base_url=url, headers=headers_of(key), transport=transport)
        self._do = Operations(Exchange(AsyncWire(self._http), timeout, retries), key is not None)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """As :meth:`service.client.Client.close`."""
        await self._http.aclose()

    async def watermark(
        self,
        asset: Source,
        text: str | None = None,
        *,
        filename: str | None = None,
        idempotency_key: str | None = None,
        wait: bool = True,
        on_progress: OnProgress | None = None,
        **order: Unpack[Order],
    ) -> AsyncJob:
        """As :meth:`service.client.Client.watermark`."""
        form = watermark_form(asset, text, filename, order)
        return await self._made("watermarks", form, idempotency_key, wait, on_progress)

    def watermark_all(
        self, assets: Iterable[Source], text: str | None = None, *, concurrency: int = 4, **order: Unpack[Order]
    ) -> AsyncGenerator[Outcome[AsyncJob], None]:
        """As :meth:`service.client.Client.watermark_all`."""
        one = partial(self.watermark, text=text, **order)
        return all_of_async(assets, one, concurrency)

    async def verify(
        self,
        suspect: Source,
        *,
        texts: Sequence[str] | None = None,
        watermark: str | None = None,
        keep: bool | None = None,
        original: File | None = None,
        credentials: File | None = None,
        filename: str | None = None,
        idempotency_key: str | None = None,
        wait: bool = True,
        on_progress: OnProgress | None = None,
        **sending: Unpack[Sending],
    ) -> AsyncJob:
        """As :meth:`service.client.Client.verify`."""
        params = {"texts": texts, "watermark": watermark, "keep": keep}
        parts = {"original": original, "credentials": credentials}
        form = verification_form(suspect, filename, params, parts, sending)
        return await self._made("verifications", form, idempotency_key, wait, on_progress)

    async def convert(
        self,
        asset: File,
        *,
        filename: str | None = None,
        wait: bool = True,
        on_progress: OnProgress | None = None,
    ) -> AsyncJob:
        """As :meth:`service.client.Client.convert`."""
        form = conversion_form(asset, filename)
        return await self._made("conversions", form, None, wait, on_progress)

    async def upload(self, asset: File, filename: str | None = None) -> UploadId:
        """As :meth:`service.client.Client.upload`."""
        return UploadId(await run_async(self._do.upload(asset, filename)))

    async def batch(self, items: Sequence[BatchItem]) -> list[AsyncJob | MeshmarkProblem]:
        """As :meth:`service.client.Client.batch`."""
        made = await run_async(self._do.batch(items))
        return [each if isinstance(each, MeshmarkProblem) else AsyncJob(each, self._do) for each in made]

    async def get(self, job_id: str, kind: Kind = "watermarks") -> AsyncJob:
        """As :meth:`service.client.Client.get`."""
        return AsyncJob(await run_async(self._do.read(job_path(kind, job_id))), self._do)

    async def jobs(
        self,
        kind: Listed = "watermarks",
        *,
        state: str | None = None,
        created_after: datetime | None = None,
        created_before: datetime | None = None,
        metadata: tuple[str, str] | None = None,
    ) -> AsyncIterator[AsyncJob]:
        """As :meth:`service.client.Client.jobs`."""
        page = await run_async(self._do.first_page(kind, filters_of(state, created_after, created_before, metadata)))
        while True:
            for facts in page["items"]:
                yield AsyncJob(facts, self._do)
            if page["next"] is None:
                return
            page = await run_async(self._do.read(page["next"]))

    async def copy(
        self,
        job_id: str,
        copies: Sequence[Copy],
        *,
        webhook: str | None = None,
        idempotency_key: str | None = None,
    ) -> list[AsyncJob]:
        """As :meth:`service.client.Client.copy`."""
        made = await run_async(self._do.copy(job_id, copies, webhook, idempotency_key))
        return [AsyncJob(facts, self._do) for facts in made]

    async def copies(self, job_id: str) -> AsyncIterator[AsyncJob]:
        """As :meth:`service.client.Client.copies`."""
        page = await run_async(self._do.first_copies(job_id))
        while True:
            for facts in page["items"]:
                yield AsyncJob(facts, self._do)
            if page["next"] is None:
                return
            page = await run_async(self._do.read(page["next"]))

    async def _made(
        self, kind: Kind, form: Form, key: str | None, wait: bool, on_progress: OnProgress | None
    ) -> AsyncJob:
        job = AsyncJob(await run_async(self._do.create(kind, form, key, wait and on_progress is None)), self._do)
        return await job.result(on_progress) if wait else job
