"""Routes of the manual: its pages below `/docs/`, and `/llms.txt`."""

from pathlib import Path

from fastapi import APIRouter, Request, Response
from starlette.responses import RedirectResponse

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.manual import SITE
from service.static_file import METHODS, send, static_file

# Scripts and styles are files of the site, but for the style of its search dialog, which its script writes into the
# page; search is a worker that reads a file; icons are masks in data URLs.
SEARCH_STYLE = "sha256-NwSx/R2V/U4jnW0Tq5pQ53Y/rzPVJ4dqE7D6UTA/J1k="
POLICY = (
    f"default-src 'none'; script-src 'self'; style-src 'self' '{SEARCH_STYLE}'; img-src 'self' data:; "
    "connect-src 'self'; "
    "worker-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
PAGE = "index.html"


def manual_router(site: Path = SITE) -> APIRouter:
    """The routes of a site that was built into a folder; what is not there when this is called is not served."""
    router = APIRouter(include_in_schema=False)
    files = {path.relative_to(site).as_posix(): path for path in site.rglob("*.*") if path.is_file()}

    def answer(request: Request, name: str) -> Response:
        if name in files:
            return send(request, static_file(files[name]), POLICY)
        if f"{name}/{PAGE}" in files:  # by a relative address: this one's host is whatever the request says
            return RedirectResponse(f"{name.rpartition('/')[2]}/", 308)
        if not files:
            raise MeshmarkError(
                ServiceErrorCode.NOT_FOUND,
                "The manual is not built here.",
                "Run `make install`, or `python -m service.manual` with the package's extra `docs`, and start again.",
            )
        raise MeshmarkError(
            ServiceErrorCode.NOT_FOUND, f"The manual has no page {name!r}.", "/docs/ has a list of its pages."
        )

    @router.api_route("/docs", methods=METHODS)
    async def redirect_to_manual() -> Response:
        return RedirectResponse("docs/", 308)

    @router.api_route("/docs/{name:path}", methods=METHODS)
    async def read_manual(request: Request, name: str) -> Response:
        return answer(request, f"{name}{PAGE}" if name.endswith("/") or not name else name)

    @router.api_route("/llms.txt", methods=METHODS)
    async def read_llms(request: Request) -> Response:
        return answer(request, "llms.txt")

    return router
