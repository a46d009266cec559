"""Routes of the API reference at `/reference`: a viewer of `/openapi.json`, from npm by the console's lock file."""

from pathlib import Path

from fastapi import APIRouter, Request, Response

from core.errors import MeshmarkError
from service.console.site import LIBRARIES, STATIC
from service.errors import ServiceErrorCode
from service.static_file import METHODS, send, static_file

OWN = Path(__file__).parents[1] / "reference"
# The viewer's icons are data URLs; a picture that a request brings back is shown as a blob.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


def reference_router(libraries: Path = LIBRARIES) -> APIRouter:
    """The routes of the page, with the viewer out of a folder of packages."""
    router = APIRouter(include_in_schema=False)
    viewer = libraries / "swagger-ui-dist"
    files = {
        "style.css": OWN / "style.css",
        "start.js": OWN / "start.js",
        "icon.svg": STATIC / "icon.svg",
        "swagger-ui.css": viewer / "swagger-ui.css",
        "swagger-ui-bundle.js": viewer / "swagger-ui-bundle.js",
    }

    @router.api_route("/reference", methods=METHODS)
    async def read_reference(request: Request) -> Response:
        if not all(path.is_file() for path in files.values()):
            raise MeshmarkError(
                ServiceErrorCode.NOT_FOUND,
                "The viewer of the API reference is not installed here.",
                "Run `make install`; the document that it shows is at /openapi.json.",
            )
        return send(request, static_file(OWN / "index.html"), POLICY)

    @router.api_route("/reference/{name}", methods=METHODS)
    async def read_reference_file(request: Request, name: str) -> Response:
        if name not in files or not files[name].is_file():
            raise MeshmarkError(ServiceErrorCode.NOT_FOUND, "The reference has no such file.", "Load /reference anew.")
        return send(request, static_file(files[name]), POLICY)

    return router
