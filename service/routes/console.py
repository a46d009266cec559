"""Routes of the console: the page at `/`, and its files."""

from fastapi import APIRouter, Request, Response

from core.errors import MeshmarkError
from service.console.site import PREFIX, allowing, site
from service.errors import ServiceErrorCode
from service.state import State
from service.static_file import METHODS, send

router = APIRouter(include_in_schema=False)

ANY = "0" * 64  # the name of a content that need not be there


@router.api_route("/", methods=METHODS)
def read_console(request: Request, state: State) -> Response:
    """The page; whatever it shows it asks the API for."""
    response = send(request, site().page, allowing(site().policy, state.artifacts.link(ANY)))
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
    return send(request, file, site().policy)
