"""Delivery of stored content over HTTP: whole, a byte range, or 304 Not Modified."""

import re
from itertools import chain
from urllib.parse import quote

from fastapi import Request, Response, status
from fastapi.responses import RedirectResponse, StreamingResponse

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs.artifacts import ArtifactStore
from service.jobs.models import Artifact
from service.problems import problem_response
from service.store_threads import StoreThreads

ENTITY_TAG = re.compile(r'(W/)?("[\x21\x23-\x7e\x80-\xff]*")')
ONE_RANGE = re.compile(r"bytes=\s*(\d{0,18})-(\d{0,18})\s*", re.IGNORECASE)


def deliver(
    request: Request, store: ArtifactStore, threads: StoreThreads, artifact: Artifact, headers: dict[str, str]
) -> Response:
    """Response to a GET or HEAD for stored content, in the order of RFC 9110, section 13.2.2.

    Args:
        request: its If-Match, If-None-Match, Range and If-Range are obeyed.
        store: the store of the content.
        threads: pool in which the content is read while it is sent.
        artifact: the content.
        headers: of an answer that carries the content, such as its Content-Type.

    Raises:
        FileNotFoundError: the content is gone.
        MeshmarkError: ``precondition_failed``.
        StoreUnavailableError: the store does not answer.
    """
    tag = f'"{artifact.sha256}"'
    always = {"ETag": tag, "Cache-Control": "private, no-cache"}
    if not is_precondition_met(request.headers.get("If-Match"), tag):
        raise MeshmarkError(
            ServiceErrorCode.PRECONDITION_FAILED,
            "The content is another one than If-Match names.",
            "Fetch it anew, without If-Match.",
        )
    if is_not_modified(request.headers.get("If-None-Match"), tag):
        return Response(status_code=status.HTTP_304_NOT_MODIFIED, headers=always)
    headers = {**headers, **always, "Accept-Ranges": "bytes"}
    if request.method == "HEAD":
        if not store.has(artifact.sha256):
            raise FileNotFoundError(artifact.sha256)
        return Response(headers={**headers, "Content-Length": str(artifact.size)})
    if link := store.link(artifact.sha256):
        return RedirectResponse(link, headers={"Cache-Control": "private, no-store"})
    wanted = request.headers.get("Range") if request.headers.get("If-Range", tag) == tag else None
    try:
        part = requested_range(wanted, artifact.size)
    except MeshmarkError as error:
        return problem_response(error, {"Content-Range": f"bytes */{artifact.size}"})
    start, stop = part or (0, artifact.size)
    chunks = store.read(artifact.sha256, start, stop)
    first = next(chunks, b"")  # read here, where an error can still become a response
    headers["Content-Length"] = str(stop - start)
    if part:
        headers["Content-Range"] = f"bytes {start}-{stop - 1}/{artifact.size}"
    code = status.HTTP_206_PARTIAL_CONTENT if part else status.HTTP_200_OK
    return StreamingResponse(threads.each(chain([first], chunks)), code, headers)


def disposition(name: str, kind: str = "attachment") -> str:
    """The Content-Disposition of a file to be saved under a name, or of kind "inline" to be shown (RFC 6266): in ASCII,
    and as it is if that differs."""
    plain = "".join(character if " " <= character <= "~" and character not in '"\\%' else "_" for character in name)
    return f'{kind}; filename="{plain}"' + ("" if plain == name else f"; filename*=UTF-8''{quote(name, safe='')}")


def is_not_modified(if_none_match: str | None, tag: str) -> bool:
    """Test whether If-None-Match names this entity tag (RFC 9110, section 13.1.2: by weak comparison)."""
    if if_none_match is None:
        return False
    return if_none_match.strip() == "*" or any(named == tag for _, named in ENTITY_TAG.findall(if_none_match))


def is_precondition_met(if_match: str | None, tag: str) -> bool:
    """Test whether If-Match allows content of this entity tag (RFC 9110, section 13.1.1: by strong comparison)."""
    return if_match is None or if_match.strip() == "*" or ("", tag) in ENTITY_TAG.findall(if_match)


def requested_range(header: str | None, size: int) -> tuple[int, int] | None:
    """Byte range of a Range header as (start, stop); None for the whole content (RFC 9110, section 14.2).

    A header that is malformed, in other units or of several ranges is ignored, as the RFC allows.

    Raises:
        MeshmarkError: ``range_not_satisfiable``.
    """
    match = ONE_RANGE.fullmatch(header or "")
    if match is None or match.groups() == ("", ""):
        return None
    first, last = match.groups()
    if not first:  # a suffix range
        start, stop = max(0, size - int(last)), size
    else:
        start, stop = int(first), min(int(last) + 1, size) if last else size
        if last and int(last) < start:
            return None
    if start >= stop:
        raise MeshmarkError(
            ServiceErrorCode.RANGE_NOT_SATISFIABLE,
            f"The range {header!r} begins after the end: there are {size:,} bytes.",
            "Ask for a range within them, or leave out the Range header.",
        )
    return start, stop
