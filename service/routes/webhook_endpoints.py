"""Routes of webhook endpoints, and of the log of their deliveries."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response, status

from core.errors import ErrorCode
from service import access
from service.access import Admitted, GuardedRoute
from service.errors import ServiceErrorCode
from service.jobs.models import DeliveryState
from service.outbound.resolve import check_address
from service.problems import problem_responses
from service.routes.webhook_schemas import (
    Delivery,
    DeliveryPage,
    EndpointChange,
    NewEndpoint,
    NewSecret,
    WebhookEndpoint,
    WebhookEndpoints,
    WebhookEndpointWithSecret,
)
from service.state import State
from service.webhooks import deliveries, endpoints

router = APIRouter(prefix="/v1/webhook-endpoints", tags=["webhooks"], route_class=GuardedRoute)

READING = (*access.REFUSALS, ServiceErrorCode.SERVICE_UNAVAILABLE)
OF_ONE = (*READING, ServiceErrorCode.NOT_FOUND)
WITH_BODY = (
    ErrorCode.INVALID_REQUEST,
    ServiceErrorCode.UNSUPPORTED_MEDIA_TYPE,
    ServiceErrorCode.UPLOAD_TOO_LARGE,
    ServiceErrorCode.REQUEST_TIMEOUT,
)
CREATED: dict[int | str, dict[str, Any]] = {
    201: {
        "description": "The new endpoint.",
        "headers": {"Location": {"description": "The endpoint's own address.", "schema": {"type": "string"}}},
    }
}


@router.post(
    "",
    summary="Make a webhook endpoint",
    status_code=status.HTTP_201_CREATED,
    responses=CREATED
    | problem_responses(
        *READING,
        *WITH_BODY,
        ServiceErrorCode.ADDRESS_REFUSED,
        ServiceErrorCode.INVALID_SECRET,
        ServiceErrorCode.ENDPOINT_EXISTS,
        ServiceErrorCode.TOO_MANY_ENDPOINTS,
    ),
)
def create_webhook_endpoint(
    request: Request, response: Response, state: State, client: Admitted, body: NewEndpoint
) -> WebhookEndpointWithSecret:
    """Make a webhook endpoint. The answer has the secret by which it verifies what it is sent."""
    if body.url is not None:
        check_address(body.url, state.settings.outbound)
    sessions, vault = state.ledger.sessions, state.vault
    row = endpoints.create_endpoint(sessions, client.tenant, body.url, body.events, body.secret, vault)
    response.headers["Location"] = request.app.url_path_for("read_webhook_endpoint", endpoint_id=row.id)
    return WebhookEndpointWithSecret.of(row, secret=vault.unseal(row.secret))


@router.get("", summary="List webhook endpoints", responses=problem_responses(*READING))
def list_webhook_endpoints(state: State, client: Admitted) -> WebhookEndpoints:
    """Your webhook endpoints, the oldest first."""
    rows = endpoints.list_endpoints(state.ledger.sessions, client.tenant)
    return WebhookEndpoints(items=[WebhookEndpoint.of(row) for row in rows])


@router.get("/{endpoint_id}", summary="Read a webhook endpoint", responses=problem_responses(*OF_ONE))
def read_webhook_endpoint(state: State, client: Admitted, endpoint_id: str) -> WebhookEndpoint:
    """One webhook endpoint."""
    return WebhookEndpoint.of(endpoints.find_endpoint(state.ledger.sessions, client.tenant, endpoint_id))


@router.patch(
    "/{endpoint_id}",
    summary="Change a webhook endpoint",
    responses=problem_responses(*OF_ONE, *WITH_BODY, ServiceErrorCode.ADDRESS_REFUSED),
)
def change_webhook_endpoint(state: State, client: Admitted, endpoint_id: str, body: EndpointChange) -> WebhookEndpoint:
    """Change a webhook endpoint. What waits for one that is disabled is given up, and can be redelivered later."""
    if body.url is not None:
        check_address(body.url, state.settings.outbound)
    events = None if body.events is None else [str(event) for event in body.events]
    row = endpoints.change_endpoint(state.ledger.sessions, client.tenant, endpoint_id, body.url, events, body.disabled)
    return WebhookEndpoint.of(row)


@router.delete(
    "/{endpoint_id}",
    summary="Delete a webhook endpoint",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=problem_responses(*OF_ONE),
)
def delete_webhook_endpoint(state: State, client: Admitted, endpoint_id: str) -> None:
    """Delete a webhook endpoint with its log; nothing more is sent to it."""
    endpoints.delete_endpoint(state.ledger.sessions, client.tenant, endpoint_id)


@router.post(
    "/{endpoint_id}/rotate-secret",
    summary="Change a webhook endpoint's secret",
    responses=problem_responses(*OF_ONE, *WITH_BODY, ServiceErrorCode.INVALID_SECRET),
)
def rotate_webhook_secret(
    state: State, client: Admitted, endpoint_id: str, body: NewSecret | None = None
) -> WebhookEndpointWithSecret:
    """Give an endpoint another secret. For 24 hours, or until the next rotation, messages are signed with both."""
    secret = body.secret if body else None
    row = endpoints.rotate_secret(state.ledger.sessions, client.tenant, endpoint_id, secret, state.vault)
    return WebhookEndpointWithSecret.of(row, secret=state.vault.unseal(row.secret))


@router.get(
    "/{endpoint_id}/deliveries",
    summary="List deliveries of a webhook endpoint",
    responses=problem_responses(*OF_ONE, ErrorCode.INVALID_REQUEST),
)
def list_webhook_deliveries(
    request: Request,
    state: State,
    client: Admitted,
    endpoint_id: str,
    delivery_state: Annotated[
        DeliveryState | None, Query(alias="state", description="Only deliveries in this state.")
    ] = None,
    limit: Annotated[int, Query(ge=1, le=100, description="Most deliveries to list.")] = 20,
    cursor: Annotated[str | None, Query(max_length=200, description="As `next` has it.")] = None,
) -> DeliveryPage:
    """What was sent to an endpoint or is about to be, newest first."""
    page = deliveries.list_deliveries(state.ledger.sessions, client.tenant, endpoint_id, delivery_state, limit, cursor)
    following = request.url.include_query_params(cursor=page.cursor)
    return DeliveryPage(
        items=[Delivery.of(row) for row in page.deliveries],
        next=f"{following.path}?{following.query}" if page.cursor else None,
    )


@router.post(
    "/{endpoint_id}/deliveries/{delivery_id}/redeliver",
    summary="Send a webhook again",
    status_code=status.HTTP_202_ACCEPTED,
    responses=problem_responses(*OF_ONE, ServiceErrorCode.ENDPOINT_DISABLED),
)
def redeliver_webhook(state: State, client: Admitted, endpoint_id: str, delivery_id: str) -> Delivery:
    """Send a webhook once more, at once."""
    return Delivery.of(deliveries.redeliver(state.ledger.sessions, client.tenant, endpoint_id, delivery_id))
