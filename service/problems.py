"""Errors over HTTP: RFC 9457 problem details, with a stable `code` and a `remedy`."""

from collections.abc import Mapping
from http import HTTPStatus
from typing import Annotated, Any

import structlog
from fastapi import FastAPI, Request, params
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.exc import OperationalError
from starlette.exceptions import HTTPException
from starlette.middleware.body_limit import MAX_BODY_SIZE_SCOPE_KEY
from starlette.routing import compile_path

from core.errors import ErrorCode, MeshmarkError
from core.validation import describe, shortened
from service.metrics import PROBLEMS

MEDIA_TYPE = "application/problem+json"
FORMS = ("multipart/form-data", "application/x-www-form-urlencoded")
HOW_TO_SEND = "Send multipart/form-data with the asset as the file part `file` and JSON in the field `params`."
HOW_TO_SEND_JSON = "Send what /docs describes, as application/json."

STATUS: dict[ErrorCode, int] = {
    ErrorCode.EMPTY_FILE: 422,
    ErrorCode.UNKNOWN_FORMAT: 415,
    ErrorCode.UNSUPPORTED_FORMAT: 415,
    ErrorCode.UNSUPPORTED_FEATURE: 422,
    ErrorCode.MALFORMED_FILE: 422,
    ErrorCode.TRUNCATED_FILE: 422,
    ErrorCode.NO_FACES: 422,
    ErrorCode.NON_FINITE_POSITIONS: 422,
    ErrorCode.INDEX_OUT_OF_RANGE: 422,
    ErrorCode.BUDGET_EXCEEDED: 422,
    ErrorCode.EXTERNAL_REFERENCE: 422,
    ErrorCode.TEXTURE_NOT_DECODED: 422,
    ErrorCode.INVALID_PARAMETERS: 422,
    ErrorCode.EMPTY_TEXT: 422,
    ErrorCode.MISSING_GLYPHS: 422,
    ErrorCode.INVALID_FONT: 422,
    ErrorCode.UNKNOWN_REGION: 422,
    ErrorCode.NO_PLACEMENT: 422,
    ErrorCode.NOT_MANIFOLD: 422,
    ErrorCode.RENDERING_UNAVAILABLE: 500,
    ErrorCode.EVALUATION_FAILED: 500,
    ErrorCode.OUTPUT_NOT_WRITABLE: 500,
    ErrorCode.MODEL_UNAVAILABLE: 500,
    ErrorCode.DEVICE_UNAVAILABLE: 500,
    ErrorCode.INTERNAL_ERROR: 500,
    ErrorCode.TIME_LIMIT: 500,
    ErrorCode.MEMORY_LIMIT: 500,
    ErrorCode.ENGINE_CRASHED: 500,
    ErrorCode.WORKER_LOST: 500,
    ErrorCode.UPLOAD_TOO_LARGE: 413,
    ErrorCode.UPLOAD_NOT_SENT: 409,
    ErrorCode.UPLOAD_MISMATCH: 422,
    ErrorCode.UPLOAD_EXPIRED: 410,
    ErrorCode.TOO_MANY_UPLOADS: 429,
    ErrorCode.QUOTA_EXCEEDED: 403,  # not 507, as for a fault of ours that passes, nor 413: a smaller one may not fit
    ErrorCode.MISSING_FILE: 422,
    ErrorCode.SOURCE_URL_DISABLED: 422,
    ErrorCode.ADDRESS_REFUSED: 422,
    ErrorCode.DOWNLOAD_FAILED: 422,
    ErrorCode.DOWNLOAD_TOO_LARGE: 422,
    ErrorCode.INVALID_SECRET: 422,
    ErrorCode.TOO_MANY_ENDPOINTS: 409,
    ErrorCode.ENDPOINT_EXISTS: 409,
    ErrorCode.ENDPOINT_DISABLED: 409,
    ErrorCode.NO_WEBHOOK_SECRET: 422,
    ErrorCode.INVALID_API_KEY: 401,
    ErrorCode.INVALID_HOOK_TOKEN: 401,
    ErrorCode.MISSING_SCOPE: 403,
    ErrorCode.RATE_LIMITED: 429,
    ErrorCode.TOO_MANY_JOBS: 429,
    ErrorCode.TOO_MANY_STREAMS: 429,
    ErrorCode.IDEMPOTENCY_KEY_IN_USE: 409,
    ErrorCode.IDEMPOTENCY_KEY_REUSED: 422,
    ErrorCode.INVALID_METADATA: 422,
    ErrorCode.NOT_FOUND: 404,
    ErrorCode.NOT_READY: 409,
    ErrorCode.JOB_FAILED: 409,
    ErrorCode.JOB_CANCELED: 409,
    ErrorCode.JOB_EXPIRED: 410,
    ErrorCode.RANGE_NOT_SATISFIABLE: 416,
    ErrorCode.PRECONDITION_FAILED: 412,
    ErrorCode.INVALID_REQUEST: 400,
    ErrorCode.REQUEST_TIMEOUT: 408,
    ErrorCode.UNSUPPORTED_MEDIA_TYPE: 415,
    ErrorCode.METHOD_NOT_ALLOWED: 405,
    ErrorCode.SERVICE_UNAVAILABLE: 503,
}

log = structlog.get_logger(__name__)


class Problem(BaseModel):
    """What went wrong, and what to do about it."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "type": "urn:meshmark:problem:no_faces",
                    "title": "No faces",
                    "status": 422,
                    "detail": "The OBJ file has 8 vertices but no face.",
                    "code": "no_faces",
                    "remedy": "Export the asset with its faces.",
                }
            ]
        }
    )

    type: Annotated[str, Field(description="A URI that names the kind of problem.")]
    title: Annotated[str, Field(description="The kind of problem in words.")]
    status: Annotated[int, Field(description="The HTTP status.")]
    detail: Annotated[str, Field(description="What is wrong with this request or this file.")]
    code: Annotated[ErrorCode, Field(description="A stable code to program against.")]
    remedy: Annotated[str, Field(description="What to do about it.")]


def title(code: ErrorCode) -> str:
    """A code in words."""
    return code.value.replace("_", " ").capitalize()


HEADERS: dict[ErrorCode, dict[str, str]] = {
    ErrorCode.NOT_READY: {"Retry-After": "1"},
    ErrorCode.IDEMPOTENCY_KEY_IN_USE: {"Retry-After": "1"},
    ErrorCode.TOO_MANY_JOBS: {"Retry-After": "5"},
    ErrorCode.TOO_MANY_STREAMS: {"Retry-After": "5"},
    ErrorCode.TOO_MANY_UPLOADS: {"Retry-After": "3600"},
    ErrorCode.SERVICE_UNAVAILABLE: {"Retry-After": "5"},
    ErrorCode.UPLOAD_TOO_LARGE: {"Connection": "close"},  # nobody will read what is still being sent
    ErrorCode.UPLOAD_MISMATCH: {"Connection": "close"},
    ErrorCode.REQUEST_TIMEOUT: {"Connection": "close"},
}


RETRY_AFTER = {"Retry-After": {"description": "Seconds to wait before trying again.", "schema": {"type": "integer"}}}
CHALLENGE = {"WWW-Authenticate": {"description": "What is missing, by RFC 6750.", "schema": {"type": "string"}}}
DESCRIBED_HEADERS = {401: CHALLENGE, 403: CHALLENGE, 409: RETRY_AFTER, 429: RETRY_AFTER, 503: RETRY_AFTER}


class ProblemError(MeshmarkError):
    """An error whose answer has headers of its own."""

    def __init__(self, code: ErrorCode, message: str, remedy: str, headers: Mapping[str, str]) -> None:
        super().__init__(code, message, remedy)
        self.headers = headers


def problem_of(error: MeshmarkError) -> Problem:
    """An error as clients see it."""
    return Problem(
        type=f"urn:meshmark:problem:{error.code}",
        title=title(error.code),
        status=STATUS[error.code],
        detail=error.message,
        code=error.code,
        remedy=error.remedy,
    )


def problem_response(error: MeshmarkError, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """The response that tells a client about an error."""
    problem = problem_of(error)
    headers = {**HEADERS.get(error.code, {}), **(headers or {})}
    PROBLEMS.labels(error.code).inc()
    return JSONResponse(problem.model_dump(mode="json"), problem.status, headers, MEDIA_TYPE)


def problem_responses(*codes: ErrorCode) -> dict[int | str, dict[str, Any]]:
    """What OpenAPI says about the errors a route answers with, by status."""
    by_status: dict[int | str, list[str]] = {}
    for code in codes:
        by_status.setdefault(STATUS[code], []).append(f"`{code}`")
    schema = {"schema": {"$ref": "#/components/schemas/Problem"}}
    return {
        status: {
            "description": ", ".join(names),
            "content": {MEDIA_TYPE: schema},
            **({"headers": DESCRIBED_HEADERS[status]} if status in DESCRIBED_HEADERS else {}),
        }
        for status, names in by_status.items()
    }


def upload_too_large(limit: int) -> MeshmarkError:
    """The error for a request body over the limit, in bytes."""
    return MeshmarkError(
        ErrorCode.UPLOAD_TOO_LARGE,
        f"The request is larger than the {limit:,} bytes accepted here.",
        "Send less; for assets, the operator can raise the limit.",
    )


def ledger_unavailable() -> MeshmarkError:
    """The error for a database that cannot be reached."""
    return MeshmarkError(
        ErrorCode.SERVICE_UNAVAILABLE,
        "The job ledger does not answer.",
        "Try again later; the operator can check the database.",
    )


def install_problem_handlers(app: FastAPI, body_limit: int) -> None:
    """Answer every error of an app with problem details."""

    @app.exception_handler(MeshmarkError)
    async def _known(_request: Request, error: MeshmarkError) -> JSONResponse:
        return problem_response(error, error.headers if isinstance(error, ProblemError) else None)

    @app.exception_handler(RequestValidationError)
    async def _invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        return problem_response(_invalid_request(request, error))

    @app.exception_handler(HTTPException)
    async def _http(request: Request, error: HTTPException) -> JSONResponse:
        if isinstance(error.__cause__, MeshmarkError):  # raised while the framework read the body
            return await _known(request, error.__cause__)
        headers = dict(error.headers or {})
        if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED and (methods := _methods_of(app, request.url.path)):
            headers["Allow"] = ", ".join(methods)
        return problem_response(_from_status(request, error, body_limit), headers)

    @app.exception_handler(OperationalError)
    async def _no_ledger(_request: Request, error: OperationalError) -> JSONResponse:
        log.error("the job ledger does not answer", error=str(error.orig))
        return problem_response(ledger_unavailable())

    @app.exception_handler(Exception)
    async def _unknown(request: Request, error: Exception) -> JSONResponse:
        log.error("request failed", method=request.method, path=request.url.path, exc_info=error)
        return problem_response(
            MeshmarkError(
                ErrorCode.INTERNAL_ERROR,
                "The service could not answer this request.",
                "Try again; if it happens again, report the time of the request to the operator.",
            )
        )


def _takes_form(request: Request) -> bool:
    body = getattr(request.scope.get("route"), "body_field", None)
    return body is not None and isinstance(body.field_info, params.Form)


def _invalid_request(request: Request, error: RequestValidationError) -> MeshmarkError:
    """What a route does not take, in our terms."""
    in_query = [item for item in error.errors() if item["loc"][0] == "query"]
    if in_query:
        return MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            f"The address asks for what is not possible: {describe(in_query, 'query', skip=1)}.",
            "Correct the named parameters; /docs tells what each may be.",
        )
    sent_as = request.headers.get("Content-Type", "")
    if _takes_form(request):
        if not sent_as.startswith(FORMS):
            return _unsupported(sent_as, "multipart/form-data", HOW_TO_SEND)
        without_file = any(item["loc"][-1] == "file" for item in error.errors())
        return MeshmarkError(
            ErrorCode.MISSING_FILE if without_file else ErrorCode.INVALID_REQUEST,
            f"The request is not complete or not of the right form: {describe(error.errors(), 'form', skip=1)}.",
            HOW_TO_SEND,
        )
    if sent_as.partition(";")[0].strip().lower() != "application/json":
        return _unsupported(sent_as, "application/json", HOW_TO_SEND_JSON)
    first = error.errors()[0]
    if first["type"] == "json_invalid":
        told = f"it is not JSON at character {first['loc'][1]} ({first['ctx']['error']})"
    else:
        told = describe(error.errors(), "body", skip=1)
    return MeshmarkError(ErrorCode.INVALID_REQUEST, f"The body is not as it should be: {told}.", HOW_TO_SEND_JSON)


def _unsupported(sent_as: str, expected: str, remedy: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.UNSUPPORTED_MEDIA_TYPE,
        f"The body is {shortened(sent_as) or 'of no declared type'}, not {expected}.",
        remedy,
    )


def _methods_of(app: FastAPI, path: str) -> list[str]:
    """What is possible on a path of the API; the framework itself names the methods of its first route alone."""
    described = app.openapi()["paths"]
    templates = [path] if path in described else [each for each in described if compile_path(each)[0].match(path)]
    return sorted(method.upper() for template in templates for method in described[template])


def _from_status(request: Request, error: HTTPException, body_limit: int) -> MeshmarkError:
    """An error of the web framework in our terms."""
    match error.status_code:
        case HTTPStatus.NOT_FOUND:
            return MeshmarkError(
                ErrorCode.NOT_FOUND,
                f"There is nothing at {shortened(request.url.path)}.",
                "See /openapi.json for what there is.",
            )
        case HTTPStatus.METHOD_NOT_ALLOWED:
            return MeshmarkError(
                ErrorCode.METHOD_NOT_ALLOWED,
                f"{shortened(request.method)} is not possible on {shortened(request.url.path)}.",
                "See the Allow header for what is.",
            )
        case HTTPStatus.REQUEST_ENTITY_TOO_LARGE:
            return upload_too_large(request.scope.get(MAX_BODY_SIZE_SCOPE_KEY, body_limit))
    match error.__cause__:  # of what the framework knows only that it came while the body was read
        case UnicodeDecodeError():
            trouble = "it is not UTF-8"
        case RecursionError():
            trouble = "it is nested too deeply"
        case _:
            trouble = error.detail.rstrip(".")
    return MeshmarkError(
        ErrorCode.INVALID_REQUEST,
        f"The request could not be read: {trouble}.",
        HOW_TO_SEND if _takes_form(request) else HOW_TO_SEND_JSON,
    )
