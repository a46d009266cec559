"""Files that are sent as they lie in a folder: pages, styles, scripts, pictures."""

import gzip
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path

from fastapi import Request, Response, status

from service.delivery import is_not_modified

MEDIA_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".glb": "model/gltf-binary",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".md": "text/markdown; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".ts": "text/plain; charset=utf-8",
    ".txt": "text/plain; charset=utf-8",
    ".webp": "image/webp",
}
METHODS = ["GET", "HEAD"]


@dataclass(frozen=True)
class StaticFile:
    """A file as it is sent.

    Attributes:
        content: its bytes.
        compressed: the same by gzip.
        media_type: by its suffix.
        tag: its entity tag.
        cache_control: the header.
    """

    content: bytes
    compressed: bytes
    media_type: str
    tag: str
    cache_control: str


def as_sent(content: bytes, suffix: str, cache_control: str = "no-cache") -> StaticFile:
    """A file with this content, whose name ends in ``suffix``; by default a client asks each time whether it changed.

    Raises:
        KeyError: there is no media type for its suffix.
    """
    tag = f'"{sha256(content).hexdigest()[:32]}"'
    return StaticFile(content, gzip.compress(content, 9, mtime=0), MEDIA_TYPES[suffix], tag, cache_control)


@cache
def static_file(path: Path) -> StaticFile:
    """A file of a folder, read once.

    Raises:
        KeyError: there is no media type for its suffix.
        FileNotFoundError: there is no such file.
    """
    return as_sent(path.read_bytes(), path.suffix)


def send(request: Request, file: StaticFile, policy: str) -> Response:
    """The answer to GET or HEAD for a file, with a content security policy; 304 where the client has it."""
    headers = {
        "ETag": file.tag,
        "Cache-Control": file.cache_control,
        "Content-Security-Policy": policy,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Vary": "Accept-Encoding",
    }
    if is_not_modified(request.headers.get("If-None-Match"), file.tag):
        return Response(status_code=status.HTTP_304_NOT_MODIFIED, headers=headers)
    content = file.content
    if "gzip" in request.headers.get("Accept-Encoding", ""):
        content, headers["Content-Encoding"] = file.compressed, "gzip"
    headers["Content-Length"] = str(len(content))
    return Response(b"" if request.method == "HEAD" else content, headers=headers, media_type=file.media_type)
