"""Authentication by API key (RFC 6750), authorization by scope, and rate limit of requests."""

import math
import time
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import Depends, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.routing import APIRoute
from sqlalchemy.exc import OperationalError

from service.address_limit import client_of
from service.errors import ServiceErrorCode
from service.jobs.artifacts import StoreUnavailableError
from service.jobs.limits import spend
from service.jobs.models import DEFAULT_TENANT, PUBLIC_TENANT
from service.jobs.tenants import Scope, authenticate, note_use
from service.json_request import JsonRequest
from service.problems import ProblemError
from service.state import AppState, state_of

SCHEME = "api_key"  # its name in the OpenAPI document
REFUSALS = (ServiceErrorCode.INVALID_API_KEY, ServiceErrorCode.MISSING_SCOPE, ServiceErrorCode.RATE_LIMITED)
# The body of a refused request is not read, though it may still be on its way: the connection cannot be reused.
CLOSE = {"Connection": "close"}


@dataclass(frozen=True)
class Client:
    """Tenant and API key of a request; without authentication, the default tenant and no key."""

    tenant: str = DEFAULT_TENANT
    key_id: str | None = None

    @property
    def is_public(self) -> bool:
        """True for anybody who has no key where others need one."""
        return self.tenant == PUBLIC_TENANT


class GuardedRoute(APIRoute):
    """Route that authenticates and authorizes a request before its body is read.

    A dependency would come too late: FastAPI has read the body by then.
    """

    is_public = False  # open to requests without a key too, where the service has a public mode

    def __init__(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        scope = required_scope(options["methods"])
        options["openapi_extra"] = {**(options.get("openapi_extra") or {}), "security": [{}, {SCHEME: [scope]}]}
        super().__init__(path, endpoint, **options)

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Handler that authorizes the client, then answers the request."""
        answer = super().get_route_handler()

        async def admitted(request: Request) -> Response:
            allow = authorize_anybody if self.is_public else authorize
            request.state.client = await run_in_threadpool(allow, request)
            return await answer(JsonRequest(request.scope, request.receive))

        async def guarded(request: Request) -> Response:
            try:
                return await admitted(request)
            except (OperationalError, StoreUnavailableError):
                reserve = state_of(request).artifacts.reserve
                if request.method != "DELETE" or not await run_in_threadpool(reserve.give_up):
                    raise
                return await admitted(request)  # on a full disk, deletions may use the disk space reserved for them

        return guarded


class PublicRoute(GuardedRoute):
    """Guarded route that is open to requests without a key too, where the service has a public mode."""

    is_public = True


def required_scope(methods: "set[str] | list[str]") -> Scope:
    """Scope that a key must have for these methods."""
    return Scope.READ if {"GET", "HEAD"}.issuperset(methods) else Scope.WRITE


def authorize(request: Request) -> Client:
    """Authenticate and authorize a request, and count it against the rate limit of its key.

    Raises:
        ProblemError: ``invalid_api_key``, ``rate_limited`` or ``missing_scope``.
    """
    state = state_of(request)
    if state.settings.auth == "none":
        return Client()
    header = request.headers.get("Authorization")
    scheme, _, text = (header or "").partition(" ")
    key = authenticate(state.ledger.sessions, text.strip()) if scheme.lower() == "bearer" else None
    if key is None:
        raise ProblemError(
            ServiceErrorCode.INVALID_API_KEY,
            "The request carries no API key."
            if header is None
            else "The API key is not one, or it was revoked or has expired.",
            "Send the header `Authorization: Bearer mm_...` with a key that the operator created for you.",
            CLOSE | {"WWW-Authenticate": "Bearer" if header is None else 'Bearer error="invalid_token"'},
        )
    client = Client(key.tenant_id, key.id)
    take_request(state, client)
    scope = required_scope([request.method])
    if scope not in key.scopes:
        raise ProblemError(
            ServiceErrorCode.MISSING_SCOPE,
            f"The API key {key.id} is not for this: it lacks the scope {scope}.",
            "Ask the operator for a key with this scope.",
            CLOSE | {"WWW-Authenticate": f'Bearer error="insufficient_scope", scope="{scope}"'},
        )
    note_use(state.ledger.sessions, key)
    return client


def authorize_anybody(request: Request) -> Client:
    """As :func:`authorize`; where the service has a public mode, a request without a key is counted by its address.

    Raises:
        ProblemError: as :func:`authorize` does.
    """
    state = state_of(request)
    settings = state.settings
    if settings.auth == "none" or not settings.public_verification or "Authorization" in request.headers:
        return authorize(request)
    is_question = required_scope([request.method]) is Scope.READ
    limit = state.public.questions if is_question else state.public.verifications
    address = client_of(request.client.host if request.client else "")
    if wait := limit.spend(address, time.monotonic()):
        raise ProblemError(
            ServiceErrorCode.RATE_LIMITED,
            "More requests without an API key come from this address than it may make in a minute.",
            "Send the request again after the seconds in Retry-After, or with an API key.",
            CLOSE | {"Retry-After": str(math.ceil(wait))},
        )
    return Client(PUBLIC_TENANT)


def take_request(state: AppState, client: Client) -> None:
    """Count one request against the rate limit of its key.

    Raises:
        ProblemError: ``rate_limited``.
    """
    allowed = state.settings.requests_per_minute
    if not allowed or client.key_id is None:
        return
    if wait := spend(state.ledger.sessions, client.key_id, allowed):
        raise ProblemError(
            ServiceErrorCode.RATE_LIMITED,
            f"The API key {client.key_id} makes more than {allowed:,} requests a minute.",
            "Send the request again after the seconds in Retry-After.",
            CLOSE | {"Retry-After": str(math.ceil(wait))},
        )


async def _client(request: Request) -> Client:
    client = request.state.client
    assert isinstance(client, Client)
    return client


Admitted = Annotated[Client, Depends(_client)]
