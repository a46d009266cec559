"""Requests and their answers, tried again where that is safe and may help."""

import email.utils
import random
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

import httpx2

from service.client.orders import File, Form, opened
from service.client.plans import Plan, Wire
from service.client.problems import MeshmarkProblem, problem_of, unreachable

PASSING = {429, 502, 503, 504}  # statuses of answers that may be better in a moment
REPEATABLE = {"GET", "HEAD", "PUT", "DELETE"}
NEVER_SENT = (httpx2.ConnectError, httpx2.ConnectTimeout, httpx2.PoolTimeout)
FIRST_PAUSE, LONGEST_PAUSE = 0.5, 60.0  # seconds; a service that asks for a longer one is not waited for


@dataclass(frozen=True)
class Call:
    """One request, with a form, with JSON or with a file as its body.

    `patience` are seconds beyond the usual ones in which nothing need come. `is_keyed` where its JSON has idempotency
    keys.
    """

    method: str
    path: str
    query: Mapping[str, str] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    form: Form | None = None
    patience: float = 0.0
    json: Any = None
    body: File | None = None
    is_keyed: bool = False

    @property
    def is_repeatable(self) -> bool:
        """True where the request may arrive twice and do no more than once."""
        return self.method in REPEATABLE or self.is_keyed or "Idempotency-Key" in self.headers


class Exchange:
    """Exchange of requests and answers with one service.

    Args:
        wire: how they are sent.
        timeout: seconds without a byte after which an answer is given up.
        retries: how often a request is sent again at most.
    """

    def __init__(self, wire: Wire, timeout: float, retries: int) -> None:
        self.wire, self.retries, self._timeout = wire, retries, timeout

    def ask(self, call: Call) -> Plan[Any]:
        """Answer as JSON; None where it has none.

        Raises:
            MeshmarkProblem: the service refuses the request, or does not answer it.
            OSError: a file of the form cannot be read.
        """
        attempt = 0
        while True:
            response = yield from self.open(call, attempt)
            try:
                yield self.wire.read(response)
            except httpx2.TransportError as error:
                if attempt >= self.retries or not call.is_repeatable:
                    raise unreachable(response.request, error) from error
                yield self.wire.sleep(backoff(attempt))
                attempt += 1
            else:
                return _content(response)

    def open(self, call: Call, attempt: int = 0, retries: int | None = None) -> Plan[httpx2.Response]:
        """Successful answer, of which the body has not been read. The caller closes it.

        Args:
            call: the request.
            attempt: number of attempts that came before.
            retries: in place of the exchange's own.

        Raises:
            MeshmarkProblem: as :meth:`ask` does.
            OSError: as :meth:`ask` does.
        """
        last = self.retries if retries is None else retries
        while True:
            pause: float | None = None
            request = None
            try:
                with ExitStack() as files:
                    contents: dict[str, Any] = {}
                    if call.form:
                        form: Mapping[str, Any] = yield self.wire.apart(files.enter_context, call.form.opened())
                        contents = {"data": call.form.data(), "files": form}
                    if call.body is not None:
                        contents = {"content": (yield self.wire.apart(_open, files, call.body))}
                    request = self._request(call, contents, attempt)
                    response: httpx2.Response = yield self.wire.send(request)
                if response.is_success:
                    return response
                yield self.wire.read(response)
            except httpx2.TransportError as error:
                assert request is not None
                problem = unreachable(request, error)
                problem.__cause__ = error
                may_repeat = call.is_repeatable or isinstance(error, NEVER_SENT)
            else:
                problem = problem_of(response)
                pause = _asked_pause(response)
                may_repeat = _is_passing(response.status_code, problem, call)
            if not may_repeat or attempt >= last or (pause or 0) > LONGEST_PAUSE:
                raise problem
            yield self.wire.sleep(backoff(attempt) if pause is None else pause)
            attempt += 1

    def _request(self, call: Call, contents: Mapping[str, Any], attempt: int) -> httpx2.Request:
        # Where an answer that is kept back does not get through, past an impatient proxy, one that comes at once may.
        headers = {name: value for name, value in call.headers.items() if not attempt or name != "Prefer"}
        timeout = httpx2.Timeout(self._timeout, read=self._timeout + call.patience, pool=None)
        options: dict[str, Any] = {**contents, **({"params": call.query} if call.query else {})}
        if call.json is not None:
            options["json"] = call.json
        request = self.wire.http.build_request(call.method, call.path, headers=headers, timeout=timeout, **options)
        if "://" in call.path:  # of a bucket, which is not to have the key
            request.headers.pop("Authorization", None)
        return request


def _open(files: ExitStack, body: File) -> Any:
    return files.enter_context(opened(body))


def backoff(attempt: int) -> float:
    """Seconds to pause after so many earlier attempts: doubled each time, and drawn, so that clients spread."""
    return random.uniform(0.5, 1.0) * min(FIRST_PAUSE * 2.0**attempt, LONGEST_PAUSE)


def _content(response: httpx2.Response) -> Any:
    """JSON of an answer; None where it has no content."""
    if not response.content:
        return None
    try:
        return response.json()
    except ValueError:
        raise problem_of(response) from None


def _is_passing(status: int, problem: MeshmarkProblem, call: Call) -> bool:
    """True where the same request may be answered otherwise in a moment, and may be sent again."""
    if problem.code == "idempotency_key_in_use":  # an earlier attempt of this very request is still being answered
        return True
    return status in PASSING and (call.is_repeatable or status == httpx2.codes.TOO_MANY_REQUESTS)


def _asked_pause(response: httpx2.Response) -> float | None:
    """Seconds that the service asks to wait, in either form of RFC 9110; None where it does not."""
    asked = response.headers.get("Retry-After", "")
    if asked.isascii() and asked.isdigit():
        return float(asked)
    try:
        return max(0.0, email.utils.parsedate_to_datetime(asked).timestamp() - time.time())
    except ValueError:
        return None
