"""Weights that do not ship with Meshmark: fetched once, pinned by their SHA-256, kept in a cache folder."""

import fcntl
import hashlib
import http.client
import ipaddress
import os
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from http import HTTPStatus
from pathlib import Path
from typing import IO
from urllib.parse import urlsplit

from core import __version__
from core.errors import ErrorCode, MeshmarkError
from core.notices import Notice

Progress = Callable[[int, int], None]  # called with the bytes done and the bytes in all

CHUNK = 1 << 18
ATTEMPTS = 5  # at one address; each resumes where the one before broke off
TIMEOUT = 30.0  # seconds without a byte


@dataclass(frozen=True)
class Model:
    """One file of weights.

    Attributes:
        name: on the command line.
        file: its name in the cache folder.
        urls: addresses of the file, tried in this order.
        sha256: of the whole file, in lower-case hexadecimal digits; nothing else is ever loaded.
        size: in bytes.
        licence: SPDX identifier.
    """

    name: str
    file: str
    urls: tuple[str, ...]
    sha256: str
    size: int
    licence: str


RESNET50 = Model(
    name="resnet50-v1-12-int8",
    file="resnet50-v1-12-int8.onnx",
    urls=(
        # The zoo's own mirror at a fixed revision, then the zoo itself, whose LFS quota runs out at times.
        "https://huggingface.co/onnxmodelzoo/resnet50-v1-12-int8/resolve/"
        "d843735a7f2c4a254931a633f6dc5758d52f06ee/resnet50-v1-12-int8.onnx",
        "https://github.com/onnx/models/raw/main/validated/vision/classification/resnet/model/resnet50-v1-12-int8.onnx",
    ),
    sha256="c234f30975989788b4405f25253275aae247ab6dbdd34aaa69ab0a59ff76f6d0",
    size=25_816_052,
    licence="Apache-2.0",
)
MODELS = {RESNET50.name: RESNET50}


class State(StrEnum):
    """State of a model in the cache folder."""

    INSTALLED = "installed"
    MISSING = "missing"
    UNREADABLE = "unreadable"  # it may be there, in a folder that this process cannot read
    CORRUPT = "corrupt"


@dataclass(frozen=True)
class Listed:
    """One line of ``meshmark models list``."""

    model: Model
    path: Path
    state: State


def cache_folder() -> Path:
    """``MESHMARK_MODELS``, else ``meshmark/models`` in ``XDG_CACHE_HOME``, else in ``~/.cache``.

    As the XDG base directory specification says, a relative ``XDG_CACHE_HOME`` is not used.
    """
    if own := os.environ.get("MESHMARK_MODELS"):
        return Path(own)
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (cache if cache.is_absolute() else Path.home() / ".cache") / "meshmark" / "models"


def listing(folder: Path | None = None) -> list[Listed]:
    """Every known model with its state in ``folder`` (the cache folder if None)."""
    return [Listed(model, _path(model, folder), _state(model, _path(model, folder))) for model in MODELS.values()]


def find(name: str, folder: Path | None = None) -> Path | None:
    """The file of a model whose content has just been checked, or None where it is not installed or cannot be read.

    Args:
        name: a key of ``MODELS``.
        folder: to look in; None for :func:`cache_folder`.

    Raises:
        MeshmarkError: ``model_unavailable`` for an unknown name, or a damaged file.
    """
    model = _known(name)
    path = _path(model, folder)
    match _state(model, path):
        case State.INSTALLED:
            return path
        case State.MISSING | State.UNREADABLE:
            return None
    raise MeshmarkError(
        ErrorCode.MODEL_UNAVAILABLE,
        f"{path} is damaged: it is not the model {name}.",
        f"Run `meshmark models fetch {name}` to replace it.",
    )


def unreadable(name: str, folder: Path | None = None) -> Notice | None:
    """The reason why a model that may be installed is not used, if its file cannot be read.

    Args:
        name: a key of ``MODELS``.
        folder: to look in; None for :func:`cache_folder`.
    """
    path = _path(_known(name), folder)
    if _state(MODELS[name], path) is not State.UNREADABLE:
        return None
    return Notice(
        ErrorCode.MODEL_UNAVAILABLE,
        f"The model {name} was not used: {path} cannot be read by this process.",
        "Name a folder that it may read in MESHMARK_MODELS; a worker's jobs may read nothing of the data folder.",
    )


def fetch(
    name: str,
    folder: Path | None = None,
    url: str | None = None,
    progress: Progress | None = None,
    timeout: float = TIMEOUT,
) -> Path:
    """Download a model unless it is installed, and return its file.

    An interrupted transfer is kept beside it as ``.partial``, and the next call resumes it (RFC 9110, 14.2). The file
    gets its name only once its size and SHA-256 are right. Several processes may fetch at once: one works, the others
    wait.

    Args:
        name: a key of ``MODELS``.
        folder: to put it into; None for :func:`cache_folder`.
        url: to be used instead of the known addresses. ``https``, or ``http`` on this same machine.
        progress: called with the bytes done and the bytes in all.
        timeout: seconds to wait for the server's next byte.

    Raises:
        MeshmarkError: ``model_unavailable`` for an unknown name, where no address gave the right file, or where the
            folder cannot be written.
    """
    model = _known(name)
    path = _path(model, folder)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with _alone(path.with_name(f"{path.name}.lock")):
            if _state(model, path) is not State.INSTALLED:
                _download(model, path, (url,) if url else model.urls, progress, timeout)
    except OSError as error:  # those of the network do not get here
        raise MeshmarkError(
            ErrorCode.MODEL_UNAVAILABLE,
            f"The model {name} cannot be kept in {path.parent} ({error.strerror or type(error).__name__}).",
            "Make room there, or name a folder that can be written in MESHMARK_MODELS.",
        ) from error
    return path


def _known(name: str) -> Model:
    if name not in MODELS:
        raise MeshmarkError(
            ErrorCode.MODEL_UNAVAILABLE, f"There is no model {name!r}.", f"Ask for one of: {', '.join(MODELS)}."
        )
    return MODELS[name]


def _path(model: Model, folder: Path | None) -> Path:
    return (folder or cache_folder()) / model.file


def _state(model: Model, path: Path) -> State:
    try:
        if not path.is_file():
            return State.MISSING
        right = path.stat().st_size == model.size and _sha256(path) == model.sha256
    except OSError:
        return State.UNREADABLE
    return State.INSTALLED if right else State.CORRUPT


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def _alone(lock: Path) -> Iterator[None]:
    """Only one thread or process at a time; the system releases the lock when its process ends."""
    with lock.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


class _UnusableError(Exception):
    """This address does not give the file, for the reason in the message."""


class _BrokenError(_UnusableError):
    """The transfer broke off; the received bytes are kept."""


def _download(model: Model, path: Path, urls: tuple[str, ...], progress: Progress | None, timeout: float) -> None:
    reasons = []
    for url in urls:
        try:
            return _download_from(url, model, path, progress, timeout)
        except _UnusableError as error:
            reasons.append(f"{urlsplit(url).hostname or url}: {error}")
    raise MeshmarkError(
        ErrorCode.MODEL_UNAVAILABLE,
        f"The model {model.name} could not be downloaded ({'; '.join(reasons)}).",
        f"Try again later, or put the file with the SHA-256 {model.sha256} at {path}.",
    )


def _download_from(url: str, model: Model, path: Path, progress: Progress | None, timeout: float) -> None:
    partial = path.with_name(f"{path.name}.partial")
    for _ in range(ATTEMPTS):
        start = _size(partial)
        if start > model.size:
            partial.unlink()
            start = 0
        try:
            if start < model.size:
                _receive(url, model, partial, start, progress, timeout)
        except _BrokenError:
            if _size(partial) == start:
                raise
            continue
        if _sha256(partial) == model.sha256:
            partial.replace(path)
            return
        partial.unlink()
        if start == 0:  # else it may have been the old part that was wrong
            raise _UnusableError("the file there has another SHA-256")
    raise _UnusableError(f"the transfer broke off {ATTEMPTS} times")


def _receive(url: str, model: Model, partial: Path, start: int, progress: Progress | None, timeout: float) -> None:
    """Append the missing bytes from ``start`` on, or write all where the server sends all."""
    with _request(url, partial, start, timeout) as response:
        done = _first_byte(response, start)
        length = response.headers["Content-Length"]
        if length is not None and length != str(model.size - done):
            raise _UnusableError(f"it sends {length} bytes instead of {model.size - done}")
        with partial.open("ab" if done else "wb") as file:
            for chunk in _chunks(response):
                done += len(chunk)
                if done > model.size:
                    file.truncate(0)
                    raise _UnusableError(f"it sends more than {model.size} bytes")
                file.write(chunk)
                if progress is not None:
                    progress(done, model.size)
    if done < model.size:
        raise _BrokenError(f"the transfer broke off after {done} of {model.size} bytes")


def _request(url: str, partial: Path, start: int, timeout: float) -> http.client.HTTPResponse:
    _require_safe(url)
    headers = {"User-Agent": f"meshmark/{__version__}", "Accept-Encoding": "identity"}
    if start:
        headers["Range"] = f"bytes={start}-"
    try:
        opener = urllib.request.build_opener(_SafeRedirects)
        response: http.client.HTTPResponse = opener.open(urllib.request.Request(url, headers=headers), timeout=timeout)
        return response
    except urllib.error.HTTPError as error:
        with error:  # it holds the connection
            if error.code == HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
                partial.unlink()
                raise _BrokenError("it has less than what is already here") from error
            raise _UnusableError(f"it answers {error.code} {error.reason}") from error
    except urllib.error.URLError as error:
        raise _BrokenError(str(error.reason)) from error
    except (OSError, http.client.HTTPException) as error:
        raise _BrokenError(str(error) or type(error).__name__) from error


def _first_byte(response: http.client.HTTPResponse, start: int) -> int:
    """Offset of the body in the file: ``start`` if the server supports ranges (206), 0 if it does not (200)."""
    if response.status != HTTPStatus.PARTIAL_CONTENT:
        return 0
    found = response.headers["Content-Range"] or "no range"
    if not found.startswith(f"bytes {start}-"):
        raise _UnusableError(f"asked for bytes {start}-, it sends {found}")
    return start


def _chunks(response: http.client.HTTPResponse) -> Iterator[bytes]:
    try:
        while chunk := response.read1(CHUNK):
            yield chunk
    except (OSError, http.client.HTTPException) as error:
        raise _BrokenError(str(error) or type(error).__name__) from error


def _require_safe(url: str) -> None:
    """``https`` anywhere, ``http`` only on this same machine: nobody in between may read or replace the file."""
    parts = urlsplit(url)
    if parts.scheme == "https" and parts.hostname:
        return
    if parts.scheme != "http" or not _is_loopback(parts.hostname or ""):
        raise _UnusableError("only https addresses are fetched from")


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class _SafeRedirects(urllib.request.HTTPRedirectHandler):
    """Storage behind the mirrors has hosts of its own: follow them, by the same rule, and never from https to http."""

    def redirect_request(
        self,
        req: urllib.request.Request,
        fp: IO[bytes],
        code: int,
        msg: str,
        headers: http.client.HTTPMessage,
        newurl: str,
    ) -> urllib.request.Request | None:
        fp.close()
        _require_safe(newurl)
        if req.type == "https" and urlsplit(newurl).scheme != "https":
            raise _UnusableError("it redirects from https to http")
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0
