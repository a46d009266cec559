"""Routes that take an asset in the body of a request."""

from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any

from fastapi import Request, Response
from fastapi.routing import APIRoute

from service.access import CLOSE, GuardedRoute
from service.errors import ServiceErrorCode
from service.forms import FormRequest
from service.problems import ProblemError
from service.state import AppState, state_of


class _Receiving(APIRoute):
    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """What answers a request, once its client may."""
        answer = super().get_route_handler()

        async def received(request: Request) -> Response:
            state = state_of(request)
            with upload_place(state, request.state.client.tenant):
                return await answer(FormRequest(request.scope, request.receive, state.artifacts.spool))

        return received


class AssetRoute(GuardedRoute, _Receiving):
    """A guarded route that reads forms into the staging folder, for so many requests of a tenant at a time."""


@contextmanager
def upload_place(state: AppState, tenant: str) -> Iterator[None]:
    """A place for one more request of a tenant that carries an asset.

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
    with state.uploads.taken(tenant):
        yield
