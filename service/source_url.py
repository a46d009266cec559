"""The address of an asset, in place of the asset itself."""

from functools import partial
from urllib.parse import unquote, urlsplit

from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters
from service.config import Settings
from service.jobs import sources
from service.outbound.resolve import check_address
from service.submission import Order, plain_name


def order_from_url(
    settings: Settings, tenant: str, url: str, parameters: Parameters, metadata: dict[str, str]
) -> Order:
    """The order of a job whose asset a worker downloads; what the address tells without being asked is checked here.

    Raises:
        MeshmarkError: ``source_url_disabled``, ``address_refused``.
    """
    if not settings.source_urls:
        raise MeshmarkError(
            ErrorCode.SOURCE_URL_DISABLED,
            "This service does not fetch assets from addresses.",
            "Send the asset itself, or ask the operator to set MESHMARK_SOURCE_URLS.",
        )
    check_address(url, settings.outbound)
    return Order(
        tenant,
        plain_name(unquote(urlsplit(url).path)),
        parameters,
        metadata,
        asset=None,
        origin={"source_url": url},
        record=partial(sources.record, url=url),
    )
