"""Traces of real processes, read by a receiver of our own that speaks OTLP over HTTP."""

import gzip
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest
from opentelemetry.proto.trace.v1.trace_pb2 import Span, Status

from tests.service.harness import API_COMMAND, WORKER_COMMAND, Service, redis_server
from tests.worker.engines import asset
from tests.worker.waiting import wait_until


class Receiver:
    """Keeps the spans it is sent, with the name of the service that sent them."""

    def __init__(self) -> None:
        self.spans: list[tuple[str, Span]] = []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                if self.headers.get("Content-Encoding") == "gzip":
                    body = gzip.decompress(body)
                for sent in ExportTraceServiceRequest.FromString(body).resource_spans:
                    names = {item.key: item.value.string_value for item in sent.resource.attributes}
                    for scope in sent.scope_spans:
                        outer.spans += [(names["service.name"], span) for span in scope.spans]
                self.send_response(200)
                self.end_headers()

            def log_message(self, *_: Any) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"

    def of(self, trace_id: str) -> dict[str, tuple[str, Span]]:
        """The spans of a trace by their names."""
        return {span.name: (service, span) for service, span in self.spans if span.trace_id.hex() == trace_id}


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    receiver = Receiver()
    thread = threading.Thread(target=receiver.server.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    yield receiver
    receiver.server.shutdown()
    receiver.server.server_close()
    thread.join()


def test_a_trace_leads_from_the_clients_span_over_the_request_to_the_job_and_its_stages(
    receiver: Receiver, tmp_path: Path
) -> None:
    trace_id, client_span = "0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331"
    with redis_server(tmp_path) as broker:
        service = Service(tmp_path, broker_url=broker)
        service.environment |= {"OTEL_EXPORTER_OTLP_ENDPOINT": receiver.url, "OTEL_BSP_SCHEDULE_DELAY": "100"}
        with service.running(API_COMMAND, WORKER_COMMAND):
            response = service.client.post(
                "/v1/watermarks",
                files={"file": ("asset.obj", asset("refuse"))},
                data={"params": '{"text": "HI"}'},
                headers={"traceparent": f"00-{trace_id}-{client_span}-01", "tracestate": "a=" + "b" * 200},
            )
            job = service.wait_for(response.headers["Location"], "failed")
            wait_until(lambda: {"POST /v1/watermarks", "job", "reading", "placing"} <= receiver.of(trace_id).keys())
    spans = receiver.of(trace_id)
    api, request = spans["POST /v1/watermarks"]
    worker, run = spans["job"]
    assert (api, worker) == ("meshmark-api", "meshmark-worker")
    assert (request.kind, run.kind) == (Span.SPAN_KIND_SERVER, Span.SPAN_KIND_CONSUMER)
    assert request.parent_span_id.hex() == client_span
    assert run.parent_span_id == request.span_id
    assert {item.key: item.value for item in run.attributes}["job"].string_value == job["id"]
    assert (run.status.code, run.status.message) == (Status.STATUS_CODE_ERROR, "no_placement")
    for stage in ("reading", "placing"):
        assert spans[stage][1].parent_span_id == run.span_id
        assert run.start_time_unix_nano <= spans[stage][1].start_time_unix_nano
        assert spans[stage][1].end_time_unix_nano <= run.end_time_unix_nano


def configured(script: str = "", **environment: str) -> "subprocess.CompletedProcess[str]":
    code = f"{script}\nfrom service.tracing import configure_tracing\nconfigure_tracing('a')\nprint('on it goes')"
    return subprocess.run(
        [sys.executable, "-c", code], env=os.environ | environment, capture_output=True, text=True, check=False
    )


def test_traces_that_are_asked_for_without_their_packages_stop_the_start_with_the_remedy() -> None:
    absent = "import sys\nsys.modules['opentelemetry.sdk'] = None"
    done = configured(absent, OTEL_EXPORTER_OTLP_ENDPOINT="http://127.0.0.1:4318")
    assert done.returncode == 2
    assert "pip install 'meshmark[otel]'" in done.stderr
    assert configured(absent).stdout == "on it goes\n", "nobody needs the packages who does not ask for traces"


def test_a_protocol_that_is_not_spoken_is_refused_and_what_is_switched_off_is_not_looked_at() -> None:
    grpc = {"OTEL_EXPORTER_OTLP_ENDPOINT": "http://127.0.0.1:4317", "OTEL_EXPORTER_OTLP_PROTOCOL": "grpc"}
    done = configured(**grpc)
    assert (done.returncode, "http/protobuf" in done.stderr) == (2, True)
    assert configured(**grpc, OTEL_SDK_DISABLED="true").returncode == 0
    assert configured(**grpc, OTEL_TRACES_EXPORTER="none").returncode == 0
