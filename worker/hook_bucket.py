"""Bucket of an upload hook: dropped objects are read from it, results are written to it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any, BinaryIO

import obstore
import structlog
from obstore.exceptions import BaseError, PermissionDeniedError, UnauthenticatedError
from obstore.store import S3Store

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.hooks.config import HookSource
from service.jobs import s3_bucket
from service.jobs.artifacts import CHUNK, StoreUnavailableError

REFUSALS = (PermissionDeniedError, UnauthenticatedError)
TIMEOUTS = ("5s", "120s")  # of connecting, and of a request
RETRIES: Any = {"max_retries": 2, "retry_timeout": timedelta(seconds=10)}

log = structlog.get_logger(__name__)


def open_bucket(hook: HookSource) -> S3Store:
    """Connect to the hook's bucket."""
    keys = (hook.access_key_id, hook.secret_access_key)
    return s3_bucket.open_bucket(hook.bucket, None, hook.endpoint, hook.region, *keys, TIMEOUTS, RETRIES)


def read_object(hook: HookSource, key: str, target: BinaryIO, limit: int, check: Callable[[], None]) -> None:
    """Copy an object to an open file; `check` is called before each part is written.

    Raises:
        MeshmarkError: ``download_failed``, it is not there, or may not be read; ``download_too_large``.
        StoreUnavailableError: the bucket does not answer.
    """
    size = 0
    for chunk in _content(open_bucket(hook), key):
        check()
        size += len(chunk)
        if size > limit:
            raise MeshmarkError(
                ServiceErrorCode.DOWNLOAD_TOO_LARGE,
                f"The object in the bucket is larger than the {limit:,} bytes accepted here.",
                "Drop a smaller asset, or ask the operator to raise the limit.",
            )
        target.write(chunk)


def write_object(hook: HookSource, key: str, content: Path, media_type: str) -> None:
    """Write a file to an object; it appears when it is whole.

    The content is a file, not a stream from the artifact store: the bucket's library panics if it is called while it
    reads the content of another call.

    Raises:
        MeshmarkError: it may not be written.
        StoreUnavailableError: the bucket does not answer.
    """
    with _asking():
        obstore.put(open_bucket(hook), key, content, attributes={"Content-Type": media_type})


def _content(bucket: S3Store, key: str) -> Iterator[bytes]:
    with _asking():
        for chunk in obstore.get(bucket, key).stream(min_chunk_size=CHUNK):
            yield bytes(chunk)


@contextmanager
def _asking() -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        raise MeshmarkError(
            ServiceErrorCode.DOWNLOAD_FAILED, "The object is not in the bucket any more.", "Drop it again."
        ) from None
    except REFUSALS as error:
        log.error("the bucket of a hook does not let this service in", error=s3_bucket.error_line(error))
        raise MeshmarkError(
            ServiceErrorCode.DOWNLOAD_FAILED,
            "The bucket does not let this service in.",
            "Drop the object again once the operator has checked the keys of the hook.",
        ) from None
    except (BaseError, OSError) as error:
        log.warning("the bucket of a hook does not answer", error=s3_bucket.error_line(error))
        raise StoreUnavailableError from error
