"""Every way to fail: a stable code, a sentence about this input, and what to do about it.

Nothing else reaches a user: the service and the command line print exactly these three fields.
"""

from enum import StrEnum


class ErrorCode(StrEnum):
    """Stable codes; a code is never renamed or reused once released."""

    # The uploaded file.
    EMPTY_FILE = "empty_file"
    UNKNOWN_FORMAT = "unknown_format"
    UNSUPPORTED_FORMAT = "unsupported_format"
    UNSUPPORTED_FEATURE = "unsupported_feature"
    MALFORMED_FILE = "malformed_file"
    TRUNCATED_FILE = "truncated_file"
    NO_FACES = "no_faces"
    NON_FINITE_POSITIONS = "non_finite_positions"
    INDEX_OUT_OF_RANGE = "index_out_of_range"
    BUDGET_EXCEEDED = "budget_exceeded"
    EXTERNAL_REFERENCE = "external_reference"
    TEXTURE_NOT_DECODED = "texture_not_decoded"  # a warning
    # What was asked for.
    INVALID_PARAMETERS = "invalid_parameters"
    EMPTY_TEXT = "empty_text"
    MISSING_GLYPHS = "missing_glyphs"
    INVALID_FONT = "invalid_font"
    UNKNOWN_REGION = "unknown_region"
    # The work itself.
    NO_PLACEMENT = "no_placement"
    NOT_MANIFOLD = "not_manifold"
    RENDERING_UNAVAILABLE = "rendering_unavailable"
    EVALUATION_FAILED = "evaluation_failed"
    OUTPUT_NOT_WRITABLE = "output_not_writable"
    MODEL_UNAVAILABLE = "model_unavailable"
    DEVICE_UNAVAILABLE = "device_unavailable"
    INTERNAL_ERROR = "internal_error"
    # The process around the work; raised by the worker, listed here so that all codes stand in one place.
    TIME_LIMIT = "time_limit"
    MEMORY_LIMIT = "memory_limit"
    ENGINE_CRASHED = "engine_crashed"
    WORKER_LOST = "worker_lost"
    # The service in front of it.
    UPLOAD_TOO_LARGE = "upload_too_large"
    UPLOAD_NOT_SENT = "upload_not_sent"
    UPLOAD_MISMATCH = "upload_mismatch"
    UPLOAD_EXPIRED = "upload_expired"
    TOO_MANY_UPLOADS = "too_many_uploads"
    QUOTA_EXCEEDED = "quota_exceeded"
    MISSING_FILE = "missing_file"
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
    INVALID_REQUEST = "invalid_request"
    REQUEST_TIMEOUT = "request_timeout"
    UNSUPPORTED_MEDIA_TYPE = "unsupported_media_type"
    METHOD_NOT_ALLOWED = "method_not_allowed"
    SERVICE_UNAVAILABLE = "service_unavailable"


class MeshmarkError(Exception):
    """A failure a user can read.

    Args:
        code: the stable code.
        message: one sentence that says what is wrong with this file or this request.
        remedy: one sentence that says what to do about it.
    """

    def __init__(self, code: ErrorCode, message: str, remedy: str) -> None:
        super().__init__(code, message, remedy)  # all three in args, so that pickling keeps them
        self.code = code
        self.message = message
        self.remedy = remedy

    def __str__(self) -> str:
        return f"{self.code}: {self.message} {self.remedy}"
