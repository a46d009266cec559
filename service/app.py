"""The HTTP application."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from fastapi import FastAPI
from pydantic.json_schema import models_json_schema
from starlette.types import ASGIApp, Receive, Scope, Send

from service.access import SCHEME
from service.config import Settings
from service.jobs.artifacts import GRACE
from service.jobs.ledger import Ledger
from service.jobs.queue import create_queue
from service.jobs.stores import open_store
from service.problems import Problem, install_problem_handlers, problem_response, upload_too_large
from service.routes import health, watermarks
from service.state import AppState

MAX_FIELD_BYTES = 2**16
FORM_OVERHEAD = (
    4 * MAX_FIELD_BYTES
)  # of a request that is neither asset nor font: three fields, part headers, boundaries


class DeclaredSizeLimit:
    """Refuse a request by its Content-Length before a byte of its body is read.

    FastAPI's own `max_body_size` counts what arrives, and so covers what declares nothing or lies; where the header
    tells, it would answer in plain text.
    """

    def __init__(self, app: ASGIApp, limit: int) -> None:
        self.app = app
        self.limit = limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or pass the request on."""
        declared = dict(scope.get("headers", ())).get(b"content-length", b"0")
        if declared.isdigit() and int(declared) > self.limit:
            return await problem_response(upload_too_large(self.limit))(scope, receive, send)
        return await self.app(scope, receive, send)


class Application(FastAPI):
    """FastAPI whose OpenAPI document knows that every error is a problem."""

    def openapi(self) -> dict[str, Any]:
        """The OpenAPI document."""
        if not self.openapi_schema:
            document = super().openapi()
            _, problems = models_json_schema([(Problem, "serialization")], ref_template="#/components/schemas/{model}")
            schemas = document["components"]["schemas"]
            schemas.update(problems["$defs"])
            for name in ("HTTPValidationError", "ValidationError"):  # FastAPI's own shape, which is never sent
                schemas.pop(name, None)
            document["components"]["securitySchemes"] = {
                SCHEME: {"type": "http", "scheme": "bearer", "description": "Needed where the service is set up so."}
            }
            for path in document["paths"].values():
                for operation in path.values():
                    if "HTTPValidationError" in str(operation["responses"].get("422")):
                        del operation["responses"]["422"]
        assert self.openapi_schema is not None
        return self.openapi_schema


def create_app(settings: Settings) -> FastAPI:
    """The application with its own ledger, store and queue, which open when it starts and close when it stops."""
    body_limit = settings.max_upload_bytes + settings.max_font_bytes + FORM_OVERHEAD

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        state = AppState(
            settings,
            Ledger(settings.ledger_url, settings.retention_seconds),
            open_store(settings),
            create_queue(settings),
        )
        state.artifacts.clear_staging(GRACE)
        app.state.meshmark = state
        yield
        state.queue.close()
        state.ledger.close()

    app = Application(
        title="Meshmark",
        summary="Embosses visible watermarks into 3D assets.",
        description="Send an asset and a text; follow the job; fetch the watermarked GLB, its report and a preview. "
        "Errors are RFC 9457 problem details with a stable `code` and a `remedy`.",
        version="1",
        lifespan=lifespan,
        generate_unique_id_function=lambda route: route.name,  # a client generator's method names
        form_limits={"max_files": 2, "max_fields": 3, "max_part_size": MAX_FIELD_BYTES},
    )
    app.include_router(watermarks.router, max_body_size=body_limit)
    app.include_router(health.router)
    install_problem_handlers(app, body_limit)
    app.add_middleware(DeclaredSizeLimit, limit=body_limit)
    return app
