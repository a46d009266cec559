"""The synchronous client."""

import json
import os
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self, Unpack

import httpx2

from service.client.batches import Outcome, all_of
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
from service.client.plans import SyncWire, run
from service.client.problems import MeshmarkProblem

OnProgress = Callable[["Job"], object]


class Job(JobFacts):
    """Job of a client, with what can be done with it."""

    def __init__(self, facts: dict[str, Any], operations: Operations) -> None:
        super().__init__(facts)
        self._do = operations

    def wait(self, on_progress: OnProgress | None = None) -> Self:
        """The job itself, once it has ended, well or not; `on_progress` is called with it at each change.

        Raises:
            MeshmarkProblem: the service refuses, or does not answer.
        """
        run(self._do.follow(self, lambda: on_progress(self) if on_progress else None))
        return self

    def result(self, on_progress: OnProgress | None = None) -> Self:
        """The job itself, once it has succeeded.

        Raises:
            MeshmarkProblem: it did not, or as :meth:`wait` does.
        """
        self.wait(on_progress)
        if problem := self.problem:
            raise problem
        return self

    def refresh(self) -> Self:
        """The job itself, as it stands now.

        Raises:
            MeshmarkProblem: ``not_found``, or as :meth:`wait` does.
        """
        self.facts = run(self._do.read(self.place))
        return self

    def download(self, path: str | os.PathLike[str], part: str | None = None) -> Path:
        """The path, at which a part of the job then lies whole: its model, or of a verification its page of evidence.

        A download that breaks off goes on from there.

        Args:
            path: of the file, which is replaced if it exists.
            part: `model`, `preview_model`, `export`, `report`, `preview`, `credentials`, `preview_manifest`,
                `turntable` or `poster`; of a verification `report` or `evidence`.

        Raises:
            MeshmarkProblem: ``not_ready``, ``not_found``, ..., or as :meth:`wait` does.
            OSError: it cannot be written.
        """
        return run(self._do.save(self.path_of(part), path))

    def content(self, part: str | None = None) -> bytes:
        """The content of a part, as :meth:`download` has it.

        Raises:
            MeshmarkProblem: as :meth:`download` does.
        """
        return run(self._do.content(self.path_of(part)))

    def report(self) -> dict[str, Any]:
        """The report, as the manual describes it.

        Raises:
            MeshmarkProblem: as :meth:`download` does.
        """
        return dict(json.loads(self.content("report")))

    def preview(self) -> bytes:
        """Pictures of a watermarked asset from eight sides, as one PNG.

        Raises:
            MeshmarkProblem: as :meth:`download` does.
        """
        return self.content("preview")

    def delete(self) -> None:
        """Cancel the job if it has not ended, and delete its files and what you said about it.

        Raises:
            MeshmarkProblem: as :meth:`wait` does.
        """
        run(self._do.delete(self.place))


class Client:
    """Client of a service. Safe to share between threads; close it, or use it in a `with` block.

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
        transport: httpx2.BaseTransport | None = None,
    ) -> None:
        self._http = httpx2.Client(base_url=url, headers=headers_of(key), transport=transport)
        self._do = Operations(Exchange(SyncWire(self._http), timeout, retries), key is not None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections."""
        self._http.close()

    def watermark(
        self,
        asset: Source,
        text: str | None = None,
        *,
        filename: str | None = None,
        idempotency_key: str | None = None,
        wait: bool = True,
        on_progress: OnProgress | None = None,
        **order: Unpack[Order],
    ) -> Job:
        """Job that watermarks an asset, once it has succeeded; without `wait` as soon as it is accepted.

        Args:
            asset: path or content, or an :class:`UploadId` or a :class:`SourceUrl`.
            text: the words.
            filename: name of the asset, if it is not that of its path.
            idempotency_key: of your own; else one is made up, with which the request can be repeated.
            wait: for the job's end.
            on_progress: called with the job at each change while it is waited for.
            order: parameters, `logo`, `font`, `metadata`, `webhook`, `priority`, `cache`, `copies`.

        Raises:
            MeshmarkProblem: the service refuses or does not answer, or the job fails.
            OSError: a file cannot be read.
        """
        form = watermark_form(asset, text, filename, order)
        return self._made("watermarks", form, idempotency_key, wait, on_progress)

    def watermark_all(
        self, assets: Iterable[Source], text: str | None = None, *, concurrency: int = 4, **order: Unpack[Order]
    ) -> Generator[Outcome[Job], None, None]:
        """Outcomes of many assets with the same order, so many at a time, in the order in which they end.

        An error is the outcome of its asset, and does not end the others.
        """
        one = partial(self.watermark, text=text, **order)
        return all_of(assets, one, concurrency)

    def verify(
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
    ) -> Job:
        """Job that reads the marks of a suspect file, or of a picture of it, as :meth:`watermark` gives one.

        Args:
            suspect: path or content, or an :class:`UploadId` or a :class:`SourceUrl`.
            texts: known texts that marks may say.
            watermark: id of a job of yours whose marks are looked for.
            keep: keep the files with the results.
            original: the asset without marks.
            credentials: Content Credentials that came beside the file.
            filename: as of :meth:`watermark`.
            idempotency_key: as of :meth:`watermark`; without an API key none is made up.
            wait: as of :meth:`watermark`.
            on_progress: as of :meth:`watermark`.
            sending: `metadata`, `webhook`, `priority`.

        Raises:
            MeshmarkProblem: as :meth:`watermark` does.
            OSError: as :meth:`watermark` does.
        """
        params = {"texts": texts, "watermark": watermark, "keep": keep}
        parts = {"original": original, "credentials": credentials}
        form = verification_form(suspect, filename, params, parts, sending)
        return self._made("verifications", form, idempotency_key, wait, on_progress)

    def convert(
        self,
        asset: File,
        *,
        filename: str | None = None,
        wait: bool = True,
        on_progress: OnProgress | None = None,
    ) -> Job:
        """Job that makes a plain GLB of an asset, which browsers can show, as :meth:`watermark` gives one.

        It is kept for an hour at most.

        Args:
            asset: path or content.
            filename: as of :meth:`watermark`.
            wait: as of :meth:`watermark`.
            on_progress: as of :meth:`watermark`.

        Raises:
            MeshmarkProblem: as :meth:`watermark` does.
            OSError: as :meth:`watermark` does.
        """
        form = conversion_form(asset, filename)
        return self._made("conversions", form, None, wait, on_progress)

    def upload(self, asset: File, filename: str | None = None) -> UploadId:
        """Send an asset ahead, to be named in any number of orders for a day.

        Raises:
            MeshmarkProblem: the service refuses it, or does not answer.
            OSError: it cannot be read.
        """
        return UploadId(run(self._do.upload(asset, filename)))

    def batch(self, items: Sequence[BatchItem]) -> list[Job | MeshmarkProblem]:
        """Jobs of up to 100 assets that were sent ahead or are at addresses, in the order of the items, as soon as they
        are accepted; in the place of one that is refused stands its problem.

        Raises:
            MeshmarkProblem: the service refuses the whole, or does not answer.
        """
        made = run(self._do.batch(items))
        return [each if isinstance(each, MeshmarkProblem) else Job(each, self._do) for each in made]

    def get(self, job_id: str, kind: Kind = "watermarks") -> Job:
        """A job by its id.

        Raises:
            MeshmarkProblem: ``not_found``, or the service refuses or does not answer.
        """
        return Job(run(self._do.read(job_path(kind, job_id))), self._do)

    def jobs(
        self,
        kind: Listed = "watermarks",
        *,
        state: str | None = None,
        created_after: datetime | None = None,
        created_before: datetime | None = None,
        metadata: tuple[str, str] | None = None,
    ) -> Iterator[Job]:
        """Your jobs, newest first, asked for as they are needed.

        Args:
            kind: of the jobs.
            state: only jobs in this state.
            created_after: only jobs sent after this moment, which is aware.
            created_before: only jobs sent before this moment, which is aware.
            metadata: only jobs with this name and value in their metadata.

        Raises:
            MeshmarkProblem: the service refuses, or does not answer.
        """
        page = run(self._do.first_page(kind, filters_of(state, created_after, created_before, metadata)))
        while True:
            yield from (Job(facts, self._do) for facts in page["items"])
            if page["next"] is None:
                return
            page = run(self._do.read(page["next"]))

    def copy(
        self,
        job_id: str,
        copies: Sequence[Copy],
        *,
        webhook: str | None = None,
        idempotency_key: str | None = None,
    ) -> list[Job]:
        """Jobs that mark copies of a job's asset with other texts at the places of its marks, as soon as they are
        accepted.

        Args:
            job_id: of a watermark that has succeeded.
            copies: each with its `text`, and `metadata` if you like.
            webhook: that is sent when a copy ends.
            idempotency_key: as of :meth:`watermark`.

        Raises:
            MeshmarkProblem: ``not_ready``, ``not_found``, ..., or the service refuses or does not answer.
        """
        made = run(self._do.copy(job_id, copies, webhook, idempotency_key))
        return [Job(facts, self._do) for facts in made]

    def copies(self, job_id: str) -> Iterator[Job]:
        """The copies of a job in the order in which they were asked for; `facts` has the `text` of each.

        Raises:
            MeshmarkProblem: ``not_found``, or the service refuses or does not answer.
        """
        page = run(self._do.first_copies(job_id))
        while True:
            yield from (Job(facts, self._do) for facts in page["items"])
            if page["next"] is None:
                return
            page = run(self._do.read(page["next"]))

    def _made(self, kind: Kind, form: Form, key: str | None, wait: bool, on_progress: OnProgress | None) -> Job:
        job = Job(run(self._do.create(kind, form, key, wait and on_progress is None)), self._do)
        return job.result(on_progress) if wait else job
