"""Routes of the console: the page at `/`, and its files."""

from fastapi import APIRouter, Request, Response, status

from core.errors import MeshmarkError
from service.console.site import PREFIX, SiteFile, allowing, site
from service.delivery import is_not_modified
from service.errors import ServiceErrorCode
from service.state import State

router = APIRouter(include_in_schema=False)

METHODS = ["GET", "HEAD"]
ANY = "0" * 64  # the name of a content that need not be there


@router.api_route("/", methods=METHODS)
def read_console(request: Request, state: State) -> Response:
    """The page; whatever it shows it asks the API for."""
    response = _send(request, site().page)
    policy = allowing(site().policy, state.artifacts.link(ANY))
    response.headers["Content-Security-Policy"] = policy
    response.headers["Cross-Origin-Opener-Policy"] = "same-origin"
    return response


@router.api_route(PREFIX + "{name:path}", methods=METHODS)
async def read_console_file(request: Request, name: str) -> Response:
    """A module, a style sheet or a picture of the page."""
    file = site().files.get(PREFIX + name)
    if file is None:
        raise MeshmarkError(
            ServiceErrorCode.NOT_FOUND,
            "There is no such file of the console, or no longer.",
            "Load the page anew.",
        )
    return _send(request, file)


def _send(request: Request, file: SiteFile) -> Response:
    headers = {
        "ETag": file.tag,
        "Cache-Control": file.cache_control,
        "Content-Security-Policy": site().policy,
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
    if request.method == "HEAD":
        content = b""
    return Response(content, headers=headers, media_type=file.media_type)
