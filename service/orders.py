"""Orders of jobs by the source of their asset: a file, an address, or an upload that was sent ahead."""

from functools import partial
from typing import Any
from urllib.parse import unquote, urlsplit

from fastapi import UploadFile

from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters
from core.verify.parameters import VerificationParameters
from service.errors import ServiceErrorCode
from service.jobs import sources, uploads
from service.outbound.resolve import check_address
from service.state import AppState
from service.submission import Order, kind_of, plain_name
from service.webhooks.endpoints import check_job_webhook


def order_from(
    state: AppState,
    tenant: str,
    parameters: Parameters | VerificationParameters | None,
    metadata: dict[str, str],
    *,
    file: UploadFile | None = None,
    source_url: str | None = None,
    upload_id: str | None = None,
    webhook: str | None = None,
    **more: Any,
) -> Order:
    """Order of a job whose asset has one of three sources.

    An address is neither resolved nor fetched here, only checked by itself.

    Raises:
        MeshmarkError: ``missing_file``, ``invalid_request``, none or more than one of them is given;
            ``source_url_disabled``, ``address_refused``; ``no_webhook_secret``; ``not_found``, ``upload_expired``. When
            the asset is staged, ``upload_too_large``, ``upload_not_sent``, ``upload_mismatch``.
    """
    _check_one(file=file, source_url=source_url, upload_id=upload_id)
    if webhook is not None:
        check_job_webhook(state.ledger.sessions, tenant, webhook, state.settings.outbound, kind_of(parameters))
        more["webhook"] = webhook
    if file is not None:
        asset = state.artifacts.stage(file.file, limit=state.settings.max_upload_bytes, name="file")
        return Order(tenant, plain_name(file.filename), parameters, metadata, asset, **more)
    if upload_id is not None:
        upload = uploads.find(state.ledger.sessions, tenant, upload_id)
        return Order(tenant, upload.filename, parameters, metadata, uploads.stage(state.artifacts, upload), **more)
    assert source_url is not None
    if not state.settings.source_urls:
        raise MeshmarkError(
            ServiceErrorCode.SOURCE_URL_DISABLED,
            "This service does not fetch assets from addresses.",
            "Send the asset itself, or ask the operator to set MESHMARK_SOURCE_URLS.",
        )
    check_address(source_url, state.settings.outbound)
    return Order(
        tenant,
        plain_name(unquote(urlsplit(source_url).path)),
        parameters,
        metadata,
        asset=None,
        origin={"source_url": source_url},
        record=partial(sources.record, url=source_url),
        **more,
    )


def _check_one(**ways: object) -> None:
    given = [name for name, value in ways.items() if value is not None]
    if not given:
        raise MeshmarkError(
            ErrorCode.MISSING_FILE,
            "The request has no asset: no file, no `upload_id` and no `source_url`.",
            "Send it as the file part `file`, or give an `upload_id` or a `source_url`.",
        )
    if len(given) > 1:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            f"The request has more than one asset: {' and '.join(given)}.",
            "Send one of them only.",
        )
