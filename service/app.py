"""The HTTP application."""

import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from typing import Any

from fastapi import FastAPI
from starlette.types import ASGIApp, Receive, Scope, Send

from core.credentials.facts import LONGEST_SIDECAR
from core.report import Report
from core.verify.report import VerificationReport
from service.access import SCHEME
from service.address_limit import PublicLimits
from service.announcer import Announcer
from service.bodies import Bodies
from service.config import Settings
from service.forms import LISTS
from service.http_metrics import HttpMetrics
from service.intake import Intake, gate_template
from service.jobs.artifacts import GRACE
from service.jobs.ledger import Ledger
from service.jobs.ledger_metrics import LedgerCollector
from service.jobs.models import Queue
from service.jobs.queue import create_queue, depth
from service.jobs.stores import open_store
from service.metrics import metrics_server
from service.openapi_document import (
    components,
    describe_files,
    describe_head,
    restore_examples,
    without_foreign_refusals,
)
from service.present_or_absent import without_null
from service.problems import Problem, install_problem_handlers, problem_response, upload_too_large
from service.readiness import Readiness
from service.request_id import RequestId
from service.routes import (
    batch,
    console,
    conversions,
    copies,
    events,
    health,
    hooks,
    uploads,
    verifications,
    watermarks,
    webhook_endpoints,
)
from service.routes.batch import BatchResults
from service.routes.conversion_schemas import ConversionView
from service.routes.copies import CopiesMade, CopyPage
from service.routes.hooks import HOOK_SCHEME
from service.routes.manual import manual_router
from service.routes.reference import reference_router
from service.routes.report_example import REPORT
from service.routes.schemas import JobPage
from service.routes.verification_example import VERIFICATION
from service.routes.verification_schemas import VerificationPage, WatermarksRead
from service.routes.webhook_schemas import DeliveryPage, WebhookEndpoints, WebhookEndpointWithSecret
from service.state import AppState
from service.template import Template
from service.webhooks.vault import Vault, read_keys

MAX_FIELD_BYTES = 2**16  # of one form field
JSON_BYTES = 2**16  # of a request body that is neither an asset nor a list
LIST_BYTES = 2**20  # of a batch, or of a notification about objects
WITH_TWO = re.compile("/v1/verifications")
WITH_ASSET = re.compile("/v1/watermarks|/v1/conversions|/v1/uploads/[^/]+")
WITH_LIST = re.compile("/v1/watermarks/batch|/v1/watermarks/[^/]+/copies|/v1/hooks/[^/]+")
FORM_FIELDS = 7  # text fields of POST /v1/watermarks
# Answers whose examples have nulls.
EXEMPLARY = (
    WatermarksRead,
    CopyPage,
    CopiesMade,
    JobPage,
    VerificationPage,
    ConversionView,
    BatchResults,
    WebhookEndpoints,
    WebhookEndpointWithSecret,
    DeliveryPage,
)
# Bytes of a form beside its asset, font and logo: fields, part headers, boundaries.
FORM_OVERHEAD = (FORM_FIELDS + 1) * MAX_FIELD_BYTES + sum(LISTS.values())


class DeclaredSizeLimit:
    """Refuse a request by its Content-Length before a byte of its body is read.

    FastAPI's own `max_body_size` counts received bytes, and so covers bodies with no or a false Content-Length; a
    declared excess it would answer in plain text.
    """

    def __init__(self, app: ASGIApp, limit: int, of_verifications: int) -> None:
        self.app = app
        self.limits = ((WITH_TWO, of_verifications), (WITH_ASSET, limit), (WITH_LIST, LIST_BYTES))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse the request, or pass it on."""
        path = scope.get("path", "")
        limit = next((most for pattern, most in self.limits if pattern.fullmatch(path)), JSON_BYTES)
        declared = dict(scope.get("headers", ())).get(b"content-length", b"0")
        if declared.isdigit() and int(declared) > limit:
            return await problem_response(upload_too_large(limit))(scope, receive, send)
        return await self.app(scope, receive, send)


class Application(FastAPI):
    """FastAPI whose OpenAPI document knows that every error is a problem, and what a report is."""

    def build_middleware_stack(self) -> ASGIApp:
        """Middleware stack in the layers that see every response, that to an unexpected error too."""
        return RequestId(HttpMetrics(super().build_middleware_stack()))

    def openapi(self) -> dict[str, Any]:
        """The OpenAPI document."""
        if not self.openapi_schema:
            document = super().openapi()
            schemas = document["components"]["schemas"]
            schemas.update(components(Problem))
            for name, schema in (components(Report) | components(VerificationReport)).items():
                schemas.setdefault(name, schema)  # what other answers have too is described already
            restore_examples(document, *EXEMPLARY)
            schemas["Report"]["examples"] = [REPORT]
            schemas["VerificationReport"]["examples"] = [VERIFICATION]
            document["components"]["securitySchemes"] = {
                SCHEME: {"type": "http", "scheme": "bearer", "description": "Needed where the service is set up so."},
                HOOK_SCHEME: {"type": "http", "scheme": "bearer", "description": "A hook's own token, if it has one."},
            }
            without_null(document)
            without_foreign_refusals(document)
            describe_head(document)
            describe_files(document)
        assert self.openapi_schema is not None
        return self.openapi_schema


def create_app(settings: Settings, gate: Template | None = None) -> FastAPI:
    """The application with its own ledger, store and queue, which open when it starts and close when it stops.

    Args:
        settings: of the application.
        gate: template that the processes of the gate are forked from, if it is shared with others; else the
            application has one of its own.
    """
    # A verification may have an original beside the suspect file, and credentials.
    both_limit = 2 * settings.max_upload_bytes + LONGEST_SIDECAR + FORM_OVERHEAD
    body_limit = settings.max_upload_bytes + settings.max_font_bytes + settings.max_logo_bytes + FORM_OVERHEAD

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        ledger = Ledger(settings.ledger_url, settings.retention_seconds)
        artifacts, queue = open_store(settings), create_queue(settings)
        vault = Vault(read_keys(settings.secrets_key))
        parts: dict[str, Callable[[], object]] = {
            "ledger": ledger.ping,
            "broker": partial(depth, queue, Queue.SMALL),
            "store": artifacts.ping,
        }
        template = gate or gate_template()
        intake = Intake(settings, template)
        public = PublicLimits(settings.public_verifications_per_minute)
        state = AppState(settings, ledger, artifacts, queue, Announcer(queue), Readiness(parts), vault, intake, public)
        state.artifacts.clear_staging(GRACE)
        app.state.meshmark = state
        with metrics_server(settings.metrics_host, settings.metrics_port, LedgerCollector(ledger.sessions)):
            template.start()
            yield
        intake.close()
        if gate is None:
            template.close()
        state.queue.close()
        state.ledger.close()

    app = Application(
        title="Meshmark",
        summary="Embosses visible watermarks into 3D assets.",
        description="Send an asset and a text; follow the job; fetch the watermarked GLB, its report and a preview. "
        "Errors are RFC 9457 problem details with a stable `code` and a `remedy`.",
        version="1",
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
        servers=[{"url": "/", "description": "The service that has this document."}],
        lifespan=lifespan,
        docs_url=None,  # pages of the framework that load their script from another host
        redoc_url=None,
        redirect_slashes=False,  # a redirect would lead to whatever host the request names, and without TLS
        # One span a request, where service.tracing is asked for any.
        telemetry={"auto_configure": False, "metrics": False, "logs": False, "operation_spans": False},
        generate_unique_id_function=lambda route: route.name,  # a client generator's method names
        form_limits={"max_files": 3, "max_fields": FORM_FIELDS, "max_part_size": MAX_FIELD_BYTES},
    )
    app.include_router(watermarks.sending, max_body_size=body_limit)
    app.include_router(watermarks.router, max_body_size=JSON_BYTES)
    app.include_router(verifications.sending, max_body_size=both_limit)
    app.include_router(verifications.open_router, max_body_size=JSON_BYTES)
    app.include_router(verifications.router, max_body_size=JSON_BYTES)
    app.include_router(conversions.sending, max_body_size=body_limit)
    app.include_router(conversions.router, max_body_size=JSON_BYTES)
    app.include_router(batch.router, max_body_size=LIST_BYTES)
    app.include_router(copies.router, max_body_size=LIST_BYTES)
    app.include_router(uploads.router, max_body_size=JSON_BYTES)
    app.include_router(uploads.sending, max_body_size=body_limit)
    app.include_router(hooks.router, max_body_size=LIST_BYTES)
    app.include_router(events.router)
    app.include_router(webhook_endpoints.router, max_body_size=JSON_BYTES)
    app.include_router(health.router)
    app.include_router(manual_router())
    app.include_router(reference_router())
    if settings.console:
        app.include_router(console.router)
    install_problem_handlers(app, body_limit)
    app.add_middleware(DeclaredSizeLimit, limit=body_limit, of_verifications=both_limit)
    app.add_middleware(Bodies, silence=settings.client_timeout, rate=settings.client_rate)
    return app
