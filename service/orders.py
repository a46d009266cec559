"""What may stand in place of the asset itself: its address, or an upload that was sent ahead."""

from functools import partial
from urllib.parse import unquote, urlsplit

from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters
from service.jobs import sources, uploads
from service.outbound.resolve import check_address
from service.state import AppState
from service.submission import Order, plain_name


def order_from_url(state: AppState, tenant: str, url: str, parameters: Parameters, metadata: dict[str, str]) -> Order:
    """The order of a job whose asset a worker downloads; what the address tells without being asked is checked here.

    Raises:
        MeshmarkError: ``source_url_disabled``, ``address_refused``.
    """
    if not state.settings.source_urls:
        raise MeshmarkError(
            ErrorCode.SOURCE_URL_DISABLED,
            "This service does not fetch assets from addresses.",
            "Send the asset itself, or ask the operator to set MESHMARK_SOURCE_URLS.",
        )
    check_address(url, state.settings.outbound)
    return Order(
        tenant,
        plain_name(unquote(urlsplit(url).path)),
        parameters,
        metadata,
        asset=None,
        origin={"source_url": url},
        record=partial(sources.record, url=url),
    )


def order_from_upload(
    state: AppState, tenant: str, upload_id: str, parameters: Parameters, metadata: dict[str, str]
) -> Order:
    """The order of a job whose asset was sent ahead.

    Raises:
        MeshmarkError: ``not_found``, ``upload_expired``; when the asset is staged, ``upload_not_sent`` and
            ``upload_mismatch``.
    """
    upload = uploads.find(state.ledger.sessions, tenant, upload_id)
    return Order(tenant, upload.filename, parameters, metadata, uploads.stage(state.artifacts, upload))
