"""Download of a file from an address that a user gave."""

from collections.abc import Callable
from typing import BinaryIO

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.outbound.client import Answer, OutboundClient
from service.outbound.errors import Unreachable

OK = 200
REDIRECTS = range(300, 400)
TRANSIENT = (408, 425, 429, 500, 502, 503, 504)  # statuses after which a retry may succeed


class TransientDownloadError(MeshmarkError):
    """Transient failure: the same request may succeed later."""


def download(
    client: OutboundClient, url: str, target: BinaryIO, limit: int, check: Callable[[], None] = lambda: None
) -> int:
    """Write the file at a URL to an open file, and return how many bytes it has.

    Only a whole file is accepted: without a length or chunked coding from the server, a truncation would go unnoticed.
    After an error, the target holds a part that is to be discarded.

    `check` is called before each part is written; an error in it ends the download.

    Raises:
        MeshmarkError: ``address_refused``, ``download_failed``, ``download_too_large``.
        TransientDownloadError: ``download_failed``, where trying again makes sense.
    """
    try:
        with client.send("GET", url) as answer:
            _check(answer, limit)
            size = 0
            for chunk in answer.body:
                size += len(chunk)
                if size > limit:
                    raise _too_large(limit)
                check()
                target.write(chunk)
            return size
    except Unreachable as trouble:
        raise TransientDownloadError(
            ServiceErrorCode.DOWNLOAD_FAILED,
            f"The server at this address could not be used: {trouble}.",
            "Check the address, or try again later.",
        ) from trouble


def _check(answer: Answer, limit: int) -> None:
    if answer.status in REDIRECTS:
        raise _failed(
            f"The server redirects to another address (status {answer.status}).",
            "Give the final address; redirects are not followed.",
        )
    if answer.status in TRANSIENT:
        raise TransientDownloadError(
            ServiceErrorCode.DOWNLOAD_FAILED, f"The server answered with status {answer.status}.", "Try again later."
        )
    if answer.status != OK:
        raise _failed(
            f"The server answered with status {answer.status}.",
            "Check that anyone may read the file there.",
        )
    if (encoding := answer.headers.get("content-encoding", "identity").lower()) != "identity":
        raise _failed(
            f"The server sent the file encoded ({encoding[:40]}), though it was asked not to.",
            "Serve the file as it is, without Content-Encoding.",
        )
    declared = answer.headers.get("content-length")
    if declared is None and "transfer-encoding" not in answer.headers:
        raise _failed(
            "The server did not tell how long the file is.", "Serve it with a Content-Length, or upload it instead."
        )
    if declared is not None and int(declared) > limit:
        raise _too_large(limit)


def _failed(message: str, remedy: str) -> MeshmarkError:
    return MeshmarkError(ServiceErrorCode.DOWNLOAD_FAILED, message, remedy)


def _too_large(limit: int) -> MeshmarkError:
    return MeshmarkError(
        ServiceErrorCode.DOWNLOAD_TOO_LARGE,
        f"The file at this address is larger than the {limit:,} bytes accepted here.",
        "Give a smaller asset, or ask the operator to raise the limit.",
    )
