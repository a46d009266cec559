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
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".md": "text/markdown; charset=utf-8",
    ".svg": "image/svg+xml",
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
    """

    content: bytes
    compressed: bytes
    media_type: str
    tag: str


@cache
def static_file(path: Path) -> StaticFile:
    """A file of a folder, read once.

    Raises:
        KeyError: there is no media type for its suffix.
        FileNotFoundError: there is no such file.
    """
    content = path.read_bytes()
    tag = f'"{sha256(content).hexdigest()[:32]}"'
    return StaticFile(content, gzip.compress(content, 6, mtime=0), MEDIA_TYPES[path.suffix], tag)


def send(request: Request, file: StaticFile, policy: str) -> Response:
    """The answer to GET or HEAD for a file, with a content security policy; 304 where the client has it."""
    headers = {
        "ETag": file.tag,
        "Cache-Control": "no-cache",
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
