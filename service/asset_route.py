"""Routes that take an asset in the body of a request."""

from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any

from fastapi import Request, Response
from fastapi.routing import APIRoute

from service.access import CLOSE, GuardedRoute, PublicRoute
from service.errors import ServiceErrorCode
from service.forms import FormRequest
from service.problems import ProblemError
from service.state import AppState, state_of
from service.waiting import answer_at_end


class _Receiving(APIRoute):
    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Handler that counts a concurrent upload of the tenant while it reads the request and makes the answer, and
        keeps the answer back if the client prefers to wait."""
        answer = super().get_route_handler()

        async def received(request: Request) -> Response:
            state = state_of(request)
            with counted_upload(state, request.state.client.tenant):
                response = await answer(FormRequest(request.scope, request.receive, state.artifacts.spool))
            return await answer_at_end(request, response)

        return received


class AssetRoute(GuardedRoute, _Receiving):
    """Guarded route that reads forms into the staging folder, and limits a tenant's concurrent uploads."""


class PublicAssetRoute(PublicRoute, _Receiving):
    """Asset route that is open to requests without a key too, where the service has a public mode."""


@contextmanager
def counted_upload(state: AppState, tenant: str) -> Iterator[None]:
    """Count one more concurrent upload of a tenant during the block.

    Raises:
        ProblemError: ``too_many_uploads``.
    """
    most = state.settings.max_uploads_at_once
    if most and state.uploads.count(tenant) >= most:
        raise ProblemError(
            ServiceErrorCode.TOO_MANY_UPLOADS,
            f"{most:,} uploads of yours are under way, the most at a time.",
            "Send the asset again when one of them is done.",
            CLOSE | {"Retry-After": "5"},
        )
    with state.uploads.counted(tenant):
        yield
