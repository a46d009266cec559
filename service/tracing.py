"""Traces by OpenTelemetry, where the standard `OTEL_...` variables ask for them.

The API's own spans come from FastAPI, those of a job and its stages from the worker; both end in the tracer that is
set up here. Without one, every span is a no-op.
"""

import os
import sys
from collections.abc import Mapping
from typing import NoReturn

from opentelemetry import trace

from core import __version__

ENDPOINTS = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT")
PROTOCOLS = ("OTEL_EXPORTER_OTLP_TRACES_PROTOCOL", "OTEL_EXPORTER_OTLP_PROTOCOL")
SPOKEN = "http/protobuf"

tracer = trace.get_tracer("meshmark", __version__)


def configure_tracing(name: str, environment: Mapping[str, str] = os.environ) -> None:
    """Export this process's spans under a service name, if the environment names an endpoint.

    Raises:
        SystemExit: with code 2 and a line on stderr, where tracing is requested and cannot be set up.
    """
    if not _asked(environment):
        return
    protocol = next(filter(None, map(environment.get, PROTOCOLS)), SPOKEN)
    if protocol != SPOKEN:
        _refuse(f"OTEL_EXPORTER_OTLP_PROTOCOL={protocol} is not spoken here: set {SPOKEN}")
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.resources import Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError:
        _refuse("OTEL_EXPORTER_OTLP_ENDPOINT asks for traces: pip install 'meshmark[otel]', or unset it")
    named = "OTEL_SERVICE_NAME" in environment or "service.name=" in environment.get("OTEL_RESOURCE_ATTRIBUTES", "")
    resource = Resource.create({"service.version": __version__} | ({} if named else {"service.name": name}))
    provider = TracerProvider(resource=resource)  # it flushes at exit
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    trace.set_tracer_provider(provider)


def _asked(environment: Mapping[str, str]) -> bool:
    off = (
        environment.get("OTEL_SDK_DISABLED", "").lower() == "true" or environment.get("OTEL_TRACES_EXPORTER") == "none"
    )
    return not off and any(map(environment.get, ENDPOINTS))


def _refuse(message: str) -> NoReturn:
    print(message, file=sys.stderr)
    sys.exit(2)
