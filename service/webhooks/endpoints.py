"""Webhook endpoints of tenants, and the secrets that sign the messages to them.

An endpoint without a URL of its own is for the webhooks that jobs name themselves: its secret signs them, and its log
has them. A tenant has one of these at most.
"""

import uuid
from collections.abc import Iterable
from datetime import datetime, timedelta

from sqlalchemy import ColumnElement, delete, func, select, update
from sqlalchemy.orm import Session, sessionmaker

from core.errors import ErrorCode, MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs.clock import now
from service.jobs.models import DeliveryState, DisabledReason, JobKind, Tenant, WebhookDelivery, WebhookEndpoint
from service.outbound.policy import Policy
from service.outbound.resolve import check_address
from service.webhooks.signing import new_secret, parse_secret
from service.webhooks.vault import Vault

MOST = 20  # endpoints of a tenant
OVERLAP = timedelta(hours=24)  # for which messages are signed with the former secret too
IN_CLEAR = Vault([])

Sessions = sessionmaker[Session]


def check_job_webhook(
    sessions: Sessions, tenant: str, url: str, policy: Policy, kind: JobKind = JobKind.WATERMARK
) -> None:
    """Refuse the webhook of a job of some kind that cannot be sent, or not be signed.

    Raises:
        MeshmarkError: ``address_refused`` or ``no_webhook_secret``.
    """
    check_address(url, policy)
    signing = (_of(tenant), WebhookEndpoint.url.is_(None), WebhookEndpoint.disabled_reason.is_(None))
    with sessions() as session:
        endpoint = session.scalar(select(WebhookEndpoint).where(*signing))
    if endpoint is None:
        raise MeshmarkError(
            ServiceErrorCode.NO_WEBHOOK_SECRET,
            "There is no secret to sign this job's webhook with.",
            'Make one first: POST {"url": null} to /v1/webhook-endpoints. It is for all jobs that name a webhook.',
        )
    if not any(event.startswith(f"{kind}.") for event in endpoint.events):
        raise MeshmarkError(
            ServiceErrorCode.NO_WEBHOOK_SECRET,
            f"The webhook endpoint without a url, which signs this job's webhook, is not for events of a {kind}.",
            f"Add some to its `events`, such as {kind}.succeeded and {kind}.failed.",
        )


def create_endpoint(
    sessions: Sessions, tenant: str, url: str | None, events: Iterable[str], secret: str | None, vault: Vault = IN_CLEAR
) -> WebhookEndpoint:
    """Create an endpoint, and its secret where none is given; the row has it as sealed by the vault.

    Raises:
        MeshmarkError: ``invalid_secret``, ``endpoint_exists`` or ``too_many_endpoints``.
    """
    endpoint = WebhookEndpoint(
        id=str(uuid.uuid4()),
        tenant_id=tenant,
        url=url,
        events=sorted(set(events)),
        secret=vault.seal(_checked(secret)),
        created_at=now(),
    )
    with sessions.begin() as session:
        # As in service.jobs.limits: one request of a tenant at a time counts what there is, its own included.
        session.execute(select(Tenant.id).where(Tenant.id == tenant).with_for_update(key_share=True))
        session.add(endpoint)
        session.flush()
        without_url, count = session.execute(
            select(func.count().filter(WebhookEndpoint.url.is_(None)), func.count()).where(_of(tenant))
        ).one()
        if without_url > 1:
            raise MeshmarkError(
                ServiceErrorCode.ENDPOINT_EXISTS,
                "There is an endpoint without a url already, and one is enough for all jobs that name a webhook.",
                "Rotate its secret if it is not known any more, or give a url.",
            )
        if count > MOST:
            raise MeshmarkError(
                ServiceErrorCode.TOO_MANY_ENDPOINTS,
                f"There are {MOST} webhook endpoints, the most a tenant may have.",
                "Delete one that is not needed.",
            )
    return endpoint


def list_endpoints(sessions: Sessions, tenant: str) -> list[WebhookEndpoint]:
    """The tenant's endpoints, the oldest first."""
    with sessions() as session:
        order = (WebhookEndpoint.created_at, WebhookEndpoint.id)
        return list(session.scalars(select(WebhookEndpoint).where(_of(tenant)).order_by(*order)))


def find_endpoint(sessions: Sessions, tenant: str, endpoint_id: str) -> WebhookEndpoint:
    """The tenant's endpoint of an id.

    Raises:
        MeshmarkError: ``not_found``.
    """
    with sessions() as session:
        return _find(session, tenant, endpoint_id)


def change_endpoint(
    sessions: Sessions, tenant: str, endpoint_id: str, url: str | None, events: list[str] | None, disabled: bool | None
) -> WebhookEndpoint:
    """Change the values that are not None. Pending deliveries of an endpoint that is disabled now are given up.

    Raises:
        MeshmarkError: ``not_found``; ``invalid_request`` for a url of an endpoint that has none.
    """
    with sessions.begin() as session:
        endpoint = _find(session, tenant, endpoint_id, lock=True)
        if url is not None and endpoint.url is None:
            raise MeshmarkError(
                ErrorCode.INVALID_REQUEST,
                "The endpoint is for the webhooks that jobs name themselves, and has no url of its own.",
                "Make another endpoint with this url.",
            )
        endpoint.url = url or endpoint.url
        endpoint.events = endpoint.events if events is None else sorted(set(events))
        if disabled is not None:
            endpoint.disabled_reason = (endpoint.disabled_reason or DisabledReason.REQUESTED) if disabled else None
        if disabled:
            give_up(session, endpoint_id)
    return endpoint


def delete_endpoint(sessions: Sessions, tenant: str, endpoint_id: str) -> None:
    """Forget an endpoint with its log.

    Raises:
        MeshmarkError: ``not_found``.
    """
    with sessions.begin() as session:
        _find(session, tenant, endpoint_id, lock=True)
        session.execute(delete(WebhookEndpoint).where(WebhookEndpoint.id == endpoint_id))


def rotate_secret(
    sessions: Sessions, tenant: str, endpoint_id: str, secret: str | None, vault: Vault = IN_CLEAR
) -> WebhookEndpoint:
    """Give an endpoint another secret; until OVERLAP is over, or the next rotation, messages are signed with both.

    Raises:
        MeshmarkError: ``not_found`` or ``invalid_secret``.
    """
    following = vault.seal(_checked(secret))
    with sessions.begin() as session:
        endpoint = _find(session, tenant, endpoint_id, lock=True)
        endpoint.former_secret, endpoint.former_secret_until = endpoint.secret, now() + OVERLAP
        endpoint.secret = following
    return endpoint


def secrets_of(endpoint: WebhookEndpoint, moment: datetime) -> list[str]:
    """Sealed secrets that sign a message to an endpoint, the newest first."""
    former = endpoint.former_secret if endpoint.former_secret_until and endpoint.former_secret_until > moment else None
    return [endpoint.secret, former] if former else [endpoint.secret]


def give_up(session: Session, endpoint_id: str) -> None:
    """Give up all pending deliveries to an endpoint."""
    waiting = (WebhookDelivery.endpoint_id == endpoint_id, WebhookDelivery.state == DeliveryState.PENDING)
    values = {"state": DeliveryState.EXHAUSTED, "due_at": None, "announced_at": None}
    session.execute(
        update(WebhookDelivery).where(*waiting).values(**values).execution_options(synchronize_session=False)
    )


def _find(session: Session, tenant: str, endpoint_id: str, lock: bool = False) -> WebhookEndpoint:
    wanted = select(WebhookEndpoint).where(WebhookEndpoint.id == endpoint_id, _of(tenant))
    found = session.scalar(wanted.with_for_update() if lock else wanted) if endpoint_id.isprintable() else None
    if found is None:  # PostgreSQL takes no NUL
        raise MeshmarkError(
            ServiceErrorCode.NOT_FOUND,
            f"There is no webhook endpoint {endpoint_id[:64]!r}.",
            "Use the id that POST gave, or list the endpoints.",
        )
    return found


def _of(tenant: str) -> ColumnElement[bool]:
    return WebhookEndpoint.tenant_id == tenant


def _checked(secret: str | None) -> str:
    if secret is None:
        return new_secret()
    parse_secret(secret)
    return secret
