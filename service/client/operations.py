"""Operations on the service, as plans."""

import io
import json
import os
import uuid
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import IO, Any, Literal
from urllib.parse import quote

import httpx2

from service.client.exchange import Call, Exchange, backoff
from service.client.jobs import JobFacts
from service.client.orders import BatchItem, Copy, File, Form, named, new_key
from service.client.plans import Plan
from service.client.problems import MeshmarkProblem, told, unreachable

PREFERRED_WAIT = 50  # seconds that the service is asked to keep an answer back for the job's end
STREAM_PATIENCE = 30.0  # seconds beyond the usual ones: a stream of events is never silent for longer than 15
BROKEN_STREAMS = 3  # in a row, without an event, after which the job is asked for its state instead
FIRST_POLL, LONGEST_POLL = 0.5, 5.0  # seconds between two questions
PAGE = 100  # jobs of a list that are asked for at a time

Listed = Literal["watermarks", "verifications"]
Kind = Listed | Literal["conversions"]
Tell = Callable[[], object]  # called when something new is known of a job


def headers_of(key: str | None) -> dict[str, str]:
    """Headers of every request of a client."""
    return {"Accept": "application/json"} | ({} if key is None else {"Authorization": f"Bearer {key}"})


def job_path(kind: Kind, job_id: str) -> str:
    """Path of a job."""
    return f"/v1/{kind}/{quote(job_id, safe='')}"


def copies_path(job_id: str) -> str:
    """Path of a job's copies."""
    return f"{job_path('watermarks', job_id)}/copies"


def filters_of(
    state: str | None, after: datetime | None, before: datetime | None, metadata: tuple[str, str] | None
) -> dict[str, str]:
    """Query of a list of jobs."""
    moments = {"created_after": after and after.isoformat(), "created_before": before and before.isoformat()}
    given = {"state": state, **moments, "metadata": metadata and ":".join(metadata)}
    return {name: value for name, value in given.items() if value}


class Operations:
    """Operations of a client; `has_key` says whether it has an API key."""

    def __init__(self, exchange: Exchange, has_key: bool) -> None:
        self._exchange, self._wire, self._has_key = exchange, exchange.wire, has_key

    def create(self, kind: Kind, form: Form, key: str | None, wait: bool) -> Plan[dict[str, Any]]:
        """Facts of a new job; with `wait` those of its end, if it comes soon.

        Without a key of the API none for the request is made up: who verifies in public may not send one. Conversions
        take none.
        """
        if key is None and (kind == "watermarks" or (self._has_key and kind == "verifications")):
            key = new_key()
        headers = {"Prefer": f"wait={PREFERRED_WAIT}"} if wait else {}
        headers |= {} if key is None else {"Idempotency-Key": key}
        patience = PREFERRED_WAIT if wait else 0
        created = yield from self._exchange.ask(
            Call("POST", f"/v1/{kind}", form.query, headers, form, patience=patience)
        )
        return dict(created)

    def read(self, path: str) -> Plan[dict[str, Any]]:
        """Facts of a job, or a page of a list."""
        return dict((yield from self._exchange.ask(Call("GET", path))))

    def first_page(self, kind: Listed, filters: dict[str, str]) -> Plan[dict[str, Any]]:
        """First page of a list of jobs."""
        return dict((yield from self._exchange.ask(Call("GET", f"/v1/{kind}", {"limit": str(PAGE)} | filters))))

    def copy(
        self, job_id: str, copies: Sequence[Copy], webhook: str | None, key: str | None
    ) -> Plan[list[dict[str, Any]]]:
        """Facts of new copies of a job."""
        body = {"copies": list(copies)} | ({} if webhook is None else {"webhook": webhook})
        headers = {"Idempotency-Key": key or new_key()}
        made = yield from self._exchange.ask(Call("POST", copies_path(job_id), headers=headers, json=body))
        return list(made["items"])

    def first_copies(self, job_id: str) -> Plan[dict[str, Any]]:
        """First page of a list of copies."""
        return dict((yield from self._exchange.ask(Call("GET", copies_path(job_id), {"limit": str(PAGE)}))))

    def upload(self, asset: File, filename: str | None) -> Plan[str]:
        """Id of an asset that is sent ahead.

        Raises:
            MeshmarkProblem: the service refuses it, or does not answer.
            OSError: it cannot be read.
        """
        name, content = named(asset, filename)
        if isinstance(content, bytes):
            size = len(content)
        else:
            size = yield self._wire.apart(os.path.getsize, content)
        new = {"size": size, "filename": name}
        begun = yield from self._exchange.ask(Call("POST", "/v1/uploads", json=new))
        yield from self._exchange.ask(Call("PUT", begun["url"], body=content))
        return str(begun["id"])

    def batch(self, items: Sequence[BatchItem]) -> Plan[list[dict[str, Any] | MeshmarkProblem]]:
        """Facts of the job of each item, or the reason why it has none; items without an idempotency key get one."""
        keyed = [{"idempotency_key": new_key(), **item} for item in items]
        call = Call("POST", "/v1/watermarks/batch", json={"items": keyed}, is_keyed=True)
        answer = yield from self._exchange.ask(call)
        return [dict(each["job"]) if each["job"] else told(each["problem"], each["status"]) for each in answer["items"]]

    def delete(self, path: str) -> Plan[None]:
        """Cancel a job if it has not ended, and delete what is kept of it."""
        yield from self._exchange.ask(Call("DELETE", path))

    def follow(self, job: JobFacts, tell: Tell) -> Plan[None]:
        """Keep the facts of a job up to date until it has ended: by its events, or where these cannot be had by
        questions."""
        if job.has_ended:
            return
        last, broken = "", 0
        while not job.has_ended and "events" in job.links and broken < BROKEN_STREAMS:
            headers = {"Accept": "text/event-stream"} | ({"Last-Event-ID": last} if last else {})
            call = Call("GET", job.links["events"], headers=headers, patience=STREAM_PATIENCE)
            try:
                response = yield from self._exchange.open(call, retries=0)
            except MeshmarkProblem:  # as there are too many streams; a question will tell if it is more than that
                break
            broken += 1
            try:
                events = self._wire.events(response)
                while response.status_code == httpx2.codes.OK and (event := (yield self._wire.following(events))):
                    if event.data:  # the first one just says when to come back
                        _learn(job, json.loads(event.data), tell)
                        broken, last = 0, event.id
            except (httpx2.TransportError, ValueError):  # it broke off, or is no stream of events
                pass
            finally:
                yield self._wire.close(response)
            if response.status_code == httpx2.codes.NO_CONTENT:
                break
            if not job.has_ended:
                yield self._wire.sleep(backoff(broken))
        pause = FIRST_POLL
        while True:
            _learn(job, (yield from self.read(job.place)), tell)  # at its end too: events do not have all of it
            if job.has_ended:
                return
            yield self._wire.sleep(pause)
            pause = min(pause * 1.5, LONGEST_POLL)

    def content(self, path: str) -> Plan[bytes]:
        """A file of a job."""
        whole = io.BytesIO()
        yield from self._fetch(path, whole)
        return whole.getvalue()

    def save(self, path: str, target: str | os.PathLike[str]) -> Plan[Path]:
        """Path at which a file of a job lies now, whole: it is written beside it first.

        Raises:
            MeshmarkProblem: there is no such file, or the service does not answer.
            OSError: it cannot be written.
        """
        target = Path(target)
        partial = target.with_name(f".{target.name}.{uuid.uuid4().hex}.part")
        try:
            file: IO[bytes] = yield self._wire.apart(partial.open, "xb")
            try:
                yield from self._fetch(path, file)
            finally:
                yield self._wire.apart(file.close)
            yield self._wire.apart(partial.replace, target)
        finally:
            yield self._wire.apart(partial.unlink, True)
        return target

    def _fetch(self, path: str, sink: IO[bytes]) -> Plan[None]:
        """Write a file of a job; where it breaks off, go on from there if it still is the same file."""
        tag, broken = "", 0
        while True:
            there = sink.tell()
            headers = {"Accept-Encoding": "identity"}
            if there and tag:
                headers |= {"Range": f"bytes={there}-", "If-Range": tag}
            response = yield from self._exchange.open(Call("GET", path, headers=headers))
            try:
                if not _goes_on(response, tag, there):
                    sink.seek(0)
                    yield self._wire.apart(sink.truncate)
                if response.status_code != httpx2.codes.PARTIAL_CONTENT or sink.tell():
                    tag = _strong(response.headers.get("ETag", ""))
                    chunks = self._wire.chunks(response)
                    while chunk := (yield self._wire.following(chunks)):
                        yield self._wire.apart(sink.write, chunk)
                        broken = 0
                    return
                tag = ""  # a part of another file: all of that is asked for
            except httpx2.TransportError as error:
                broken += 1
                if broken > self._exchange.retries:
                    raise unreachable(response.request, error) from error
            finally:
                yield self._wire.close(response)
            if broken:
                yield self._wire.sleep(backoff(broken - 1))


def _learn(job: JobFacts, told: dict[str, Any], tell: Tell) -> None:
    known = (job.state, job.stage, job.progress)
    job.facts |= told
    if (job.state, job.stage, job.progress) != known:
        tell()


def _goes_on(response: httpx2.Response, tag: str, there: int) -> bool:
    """Test whether a response is the rest of a file of which a part is there."""
    start = response.headers.get("Content-Range", "").removeprefix("bytes ").partition("-")[0]
    same = response.headers.get("ETag") == tag
    return response.status_code == httpx2.codes.PARTIAL_CONTENT and same and start == str(there)


def _strong(tag: str) -> str:
    """An entity tag by which parts may be put together (RFC 9110, section 13.1.5); empty where it is none."""
    return "" if tag.startswith("W/") else tag
