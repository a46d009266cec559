"""Errors over HTTP: RFC 9457 problem details, with a stable `code` and a `remedy`."""

from collections.abc import Mapping
from http import HTTPStatus
from typing import Annotated, Any

import structlog
from fastapi import FastAPI, Request, params
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema
from sqlalchemy.exc import OperationalError
from starlette.exceptions import HTTPException
from starlette.middleware.body_limit import MAX_BODY_SIZE_SCOPE_KEY
from starlette.routing import compile_path

from core.errors import Code, ErrorCode, MeshmarkError
from core.validation import describe, shortened
from service.errors import ServiceErrorCode, error_code, title, type_of
from service.metrics import PROBLEMS

MEDIA_TYPE = "application/problem+json"
FORMS = ("multipart/form-data", "application/x-www-form-urlencoded")
HOW_TO_SEND = "Send multipart/form-data with the asset as the file part `file` and JSON in the field `params`."
HOW_TO_SEND_JSON = "Send what /reference describes, as application/json."

STATUS: dict[Code, int] = {  # in the order in which openapi.yaml and the manual list the codes
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
    ErrorCode.TEXT_TOO_LONG: 422,
    ErrorCode.MISSING_GLYPHS: 422,
    ErrorCode.INVALID_FONT: 422,
    ErrorCode.INVALID_LOGO: 422,
    ErrorCode.UNKNOWN_REGION: 422,
    ErrorCode.DIFFERENT_MODEL: 422,
    ErrorCode.NO_PLACEMENT: 422,
    ErrorCode.NOT_MANIFOLD: 422,
    ErrorCode.RENDERING_UNAVAILABLE: 500,
    ErrorCode.EVALUATION_FAILED: 500,
    ErrorCode.OUTPUT_NOT_WRITABLE: 500,
    ErrorCode.MODEL_UNAVAILABLE: 500,
    ErrorCode.DEVICE_UNAVAILABLE: 500,
    ErrorCode.INTERNAL_ERROR: 500,
    ErrorCode.TIME_LIMIT: 500,
    ServiceErrorCode.MEMORY_LIMIT: 500,
    ErrorCode.ENGINE_CRASHED: 500,
    ServiceErrorCode.WORKER_LOST: 500,
    ServiceErrorCode.UPLOAD_TOO_LARGE: 413,
    ServiceErrorCode.UPLOAD_NOT_SENT: 409,
    ServiceErrorCode.UPLOAD_MISMATCH: 422,
    ServiceErrorCode.UPLOAD_EXPIRED: 410,
    ServiceErrorCode.TOO_MANY_UPLOADS: 429,
    ServiceErrorCode.QUOTA_EXCEEDED: 403,  # not 507, a fault of ours that passes; nor 413, as a smaller one may not fit
    ErrorCode.MISSING_FILE: 422,
    ServiceErrorCode.SOURCE_URL_DISABLED: 422,
    ServiceErrorCode.ADDRESS_REFUSED: 422,
    ServiceErrorCode.DOWNLOAD_FAILED: 422,
    ServiceErrorCode.DOWNLOAD_TOO_LARGE: 422,
    ServiceErrorCode.INVALID_SECRET: 422,
    ServiceErrorCode.TOO_MANY_ENDPOINTS: 409,
    ServiceErrorCode.ENDPOINT_EXISTS: 409,
    ServiceErrorCode.ENDPOINT_DISABLED: 409,
    ServiceErrorCode.NO_WEBHOOK_SECRET: 422,
    ServiceErrorCode.INVALID_API_KEY: 401,
    ServiceErrorCode.INVALID_HOOK_TOKEN: 401,
    ServiceErrorCode.MISSING_SCOPE: 403,
    ServiceErrorCode.RATE_LIMITED: 429,
    ServiceErrorCode.TOO_MANY_JOBS: 429,
    ServiceErrorCode.TOO_MANY_STREAMS: 429,
    ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE: 409,
    ServiceErrorCode.IDEMPOTENCY_KEY_REUSED: 422,
    ServiceErrorCode.INVALID_METADATA: 422,
    ServiceErrorCode.NOT_FOUND: 404,
    ServiceErrorCode.NOT_READY: 409,
    ServiceErrorCode.JOB_FAILED: 409,
    ServiceErrorCode.JOB_CANCELED: 409,
    ServiceErrorCode.JOB_EXPIRED: 410,
    ServiceErrorCode.RANGE_NOT_SATISFIABLE: 416,
    ServiceErrorCode.PRECONDITION_FAILED: 412,
    ErrorCode.INVALID_REQUEST: 400,
    ServiceErrorCode.REQUEST_TIMEOUT: 408,
    ServiceErrorCode.UNSUPPORTED_MEDIA_TYPE: 415,
    ServiceErrorCode.METHOD_NOT_ALLOWED: 405,
    ServiceErrorCode.SERVICE_UNAVAILABLE: 503,
}

log = structlog.get_logger(__name__)


class _Published:
    """Describes :class:`Code` in OpenAPI as one enumeration of all codes, named ErrorCode, of engine and service."""

    @classmethod
    def __get_pydantic_core_schema__(cls, _source: Any, _handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(
            error_code, core_schema.str_schema(), ref=f"{__name__}.ErrorCode"
        )

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        reference = handler(schema)
        handler.resolve_ref_schema(reference).update(
            title="ErrorCode",
            description="Stable codes; a code is never renamed or reused once released.",
            enum=[code.value for code in STATUS],
        )
        return reference


PublishedCode = Annotated[Code, _Published]


class Problem(BaseModel):
    """What went wrong, and what to do about it."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "type": "/docs/errors/no_faces",
                    "title": "No faces",
                    "status": 422,
                    "detail": "The OBJ file has 8 vertices but no face.",
                    "code": "no_faces",
                    "remedy": "Export the asset with its faces.",
                }
            ]
        }
    )

    type: Annotated[
        str,
        Field(description="Names the kind of problem: the address of its page in the manual, relative to this one."),
    ]
    title: Annotated[str, Field(description="The kind of problem in words.")]
    status: Annotated[int, Field(description="The HTTP status.")]
    detail: Annotated[str, Field(description="What is wrong with this request or this file.")]
    code: Annotated[PublishedCode, Field(description="A stable code to program against.")]
    remedy: Annotated[str, Field(description="What to do about it.")]


HEADERS: dict[Code, dict[str, str]] = {
    ServiceErrorCode.NOT_READY: {"Retry-After": "1"},
    ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE: {"Retry-After": "1"},
    ServiceErrorCode.TOO_MANY_JOBS: {"Retry-After": "5"},
    ServiceErrorCode.TOO_MANY_STREAMS: {"Retry-After": "5"},
    ServiceErrorCode.TOO_MANY_UPLOADS: {"Retry-After": "3600"},
    ServiceErrorCode.SERVICE_UNAVAILABLE: {"Retry-After": "5"},
    ServiceErrorCode.UPLOAD_TOO_LARGE: {"Connection": "close"},  # the rest of the body is not read
    ServiceErrorCode.UPLOAD_MISMATCH: {"Connection": "close"},
    ServiceErrorCode.REQUEST_TIMEOUT: {"Connection": "close"},
}


RETRY_AFTER = {"Retry-After": {"description": "Seconds to wait before trying again.", "schema": {"type": "integer"}}}
CHALLENGE = {"WWW-Authenticate": {"description": "What is missing, by RFC 6750.", "schema": {"type": "string"}}}
DESCRIBED_HEADERS = {401: CHALLENGE, 403: CHALLENGE, 409: RETRY_AFTER, 429: RETRY_AFTER, 503: RETRY_AFTER}


class ProblemError(MeshmarkError):
    """An error whose answer has headers of its own."""

    def __init__(self, code: Code, message: str, remedy: str, headers: Mapping[str, str]) -> None:
        super().__init__(code, message, remedy)
        self.headers = headers


def problem_of(error: MeshmarkError) -> Problem:
    """Problem details of an error."""
    return Problem(
        type=type_of(error.code),
        title=title(error.code),
        status=STATUS[error.code],
        detail=error.message,
        code=error.code,
        remedy=error.remedy,
    )


def problem_response(error: MeshmarkError, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """Response with the problem details of an error."""
    problem = problem_of(error)
    headers = {**HEADERS.get(error.code, {}), **(headers or {})}
    PROBLEMS.labels(error.code).inc()
    return JSONResponse(problem.model_dump(mode="json"), problem.status, headers, MEDIA_TYPE)


def problem_responses(*codes: Code) -> dict[int | str, dict[str, Any]]:
    """OpenAPI responses of a route for these errors, by status."""
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
        ServiceErrorCode.UPLOAD_TOO_LARGE,
        f"The request is larger than the {limit:,} bytes accepted here.",
        "Send less; for assets, the operator can raise the limit.",
    )


def ledger_unavailable() -> MeshmarkError:
    """The error for a database that cannot be reached."""
    return MeshmarkError(
        ServiceErrorCode.SERVICE_UNAVAILABLE,
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
    """Error for a request that fails the validation of its route."""
    in_query = [item for item in error.errors() if item["loc"][0] == "query"]
    if in_query:
        return MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            f"The address asks for what is not possible: {describe(in_query, 'query', skip=1)}.",
            "Correct the named parameters; /reference tells what each may be.",
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
        ServiceErrorCode.UNSUPPORTED_MEDIA_TYPE,
        f"The body is {shortened(sent_as) or 'of no declared type'}, not {expected}.",
        remedy,
    )


def _methods_of(app: FastAPI, path: str) -> list[str]:
    """Methods of a path of the API; the framework itself names those of its first route alone."""
    described = app.openapi()["paths"]
    templates = [path] if path in described else [each for each in described if compile_path(each)[0].match(path)]
    return sorted(method.upper() for template in templates for method in described[template])


def _from_status(request: Request, error: HTTPException, body_limit: int) -> MeshmarkError:
    """Error for an HTTP status that the web framework raised."""
    match error.status_code:
        case HTTPStatus.NOT_FOUND:
            return MeshmarkError(
                ServiceErrorCode.NOT_FOUND,
                f"There is nothing at {shortened(request.url.path)}.",
                "See /reference or /openapi.json for what there is.",
            )
        case HTTPStatus.METHOD_NOT_ALLOWED:
            return MeshmarkError(
                ServiceErrorCode.METHOD_NOT_ALLOWED,
                f"{shortened(request.method)} is not possible on {shortened(request.url.path)}.",
                "See the Allow header for what is.",
            )
        case HTTPStatus.REQUEST_ENTITY_TOO_LARGE:
            return upload_too_large(request.scope.get(MAX_BODY_SIZE_SCOPE_KEY, body_limit))
    match error.__cause__:  # an error of which the framework only says that the body was being read
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
