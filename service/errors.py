"""The errors of the service and its workers, beside those that the engine raises."""

from core.errors import Code, ErrorCode


class ServiceErrorCode(Code):
    """Codes that only the service and its workers raise."""

    # The process around the engine.
    MEMORY_LIMIT = "memory_limit"
    WORKER_LOST = "worker_lost"
    # The service in front of it.
    UPLOAD_TOO_LARGE = "upload_too_large"
    UPLOAD_NOT_SENT = "upload_not_sent"
    UPLOAD_MISMATCH = "upload_mismatch"
    UPLOAD_EXPIRED = "upload_expired"
    TOO_MANY_UPLOADS = "too_many_uploads"
    QUOTA_EXCEEDED = "quota_exceeded"
    SOURCE_URL_DISABLED = "source_url_disabled"
    ADDRESS_REFUSED = "address_refused"
    DOWNLOAD_FAILED = "download_failed"
    DOWNLOAD_TOO_LARGE = "download_too_large"
    INVALID_SECRET = "invalid_secret"
    TOO_MANY_ENDPOINTS = "too_many_endpoints"
    ENDPOINT_EXISTS = "endpoint_exists"
    ENDPOINT_DISABLED = "endpoint_disabled"
    NO_WEBHOOK_SECRET = "no_webhook_secret"
    INVALID_API_KEY = "invalid_api_key"
    INVALID_HOOK_TOKEN = "invalid_hook_token"
    MISSING_SCOPE = "missing_scope"
    RATE_LIMITED = "rate_limited"
    TOO_MANY_JOBS = "too_many_jobs"
    TOO_MANY_STREAMS = "too_many_streams"
    IDEMPOTENCY_KEY_IN_USE = "idempotency_key_in_use"
    IDEMPOTENCY_KEY_REUSED = "idempotency_key_reused"
    INVALID_METADATA = "invalid_metadata"
    NOT_FOUND = "not_found"
    NOT_READY = "not_ready"
    JOB_FAILED = "job_failed"
    JOB_CANCELED = "job_canceled"
    JOB_EXPIRED = "job_expired"
    RANGE_NOT_SATISFIABLE = "range_not_satisfiable"
    PRECONDITION_FAILED = "precondition_failed"
    REQUEST_TIMEOUT = "request_timeout"
    UNSUPPORTED_MEDIA_TYPE = "unsupported_media_type"
    METHOD_NOT_ALLOWED = "method_not_allowed"
    SERVICE_UNAVAILABLE = "service_unavailable"


CODES: dict[str, Code] = {code.value: code for codes in (ErrorCode, ServiceErrorCode) for code in codes}


def error_code(value: str) -> Code:
    """The code of the engine or of the service that a process sent or a database stores.

    Raises:
        ValueError: there is none of this value.
    """
    try:
        return CODES[value]
    except KeyError:
        raise ValueError(f"There is no error code {value!r}.") from None


def title(code: Code) -> str:
    """A code in words."""
    return code.value.replace("_", " ").capitalize()


def type_of(code: Code) -> str:
    """The type of a code's problems: the address of its page in the manual, relative to the service's."""
    return f"/docs/errors/{code.value}"
