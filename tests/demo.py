"""`make demo`: the whole way of an asset through a running service, as an HTTP client goes it."""

import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx2

from service.client import Client, Job, MeshmarkProblem

ASSET = Path(__file__).parent / "data" / "spot.glb"
OUTPUT = Path("demo-output")
START_TIMEOUT = 300.0  # seconds; the first start compiles every module of the libraries, on a busy machine for minutes


def main() -> int:
    """Watermarks the demo asset; returns 0 when model, report and preview lie in ``demo-output``."""
    OUTPUT.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as data, service(Path(data)) as url, Client(url) as client:
        print(f"The service answers at {url}. Uploading {ASSET.name} ({ASSET.stat().st_size:,} bytes).")
        started = time.monotonic()
        try:
            job = client.watermark(ASSET, "watermark", color="#d02020", on_progress=_print_progress)
        except MeshmarkProblem as problem:
            print(problem)
            return 1
        print(f"  {job.state} after {time.monotonic() - started:.1f} s\n")
        names = {"model": "spot.glb", "report": "report.json", "preview": "preview.png"}
        paths = {part: job.download(OUTPUT / name, part) for part, name in names.items()}
    _print_report(json.loads(paths["report"].read_text()))
    for part, path in paths.items():
        print(f"  {part:8} {path.resolve()}")
    return 0


def _print_progress(job: Job) -> None:
    print(f"  {job.progress:4.0%} {job.stage or job.state}", flush=True)


@contextmanager
def service(data: Path) -> Iterator[str]:
    """The address of the embedded service on a free port, up and answering."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    environment = os.environ | {
        "MESHMARK_PORT": str(port),
        "MESHMARK_DATA_DIR": str(data / "data"),
        "MESHMARK_LOG_LEVEL": "WARNING",
    }
    print("Starting the service; the first time takes longest.", flush=True)
    process = subprocess.Popen([sys.executable, "-m", "service"], env=environment)
    try:
        url, deadline = f"http://127.0.0.1:{port}", time.monotonic() + START_TIMEOUT
        while True:
            try:
                httpx2.get(f"{url}/healthz").raise_for_status()
                break
            except httpx2.HTTPError:
                if process.poll() is not None:
                    sys.exit("The service ended before it answered; its own words are above.")
                if time.monotonic() > deadline:
                    sys.exit(f"The service did not answer within {START_TIMEOUT:.0f} seconds.")
                time.sleep(0.1)
        yield url
    finally:
        process.terminate()
        process.wait()


def _print_report(report: dict[str, dict[str, dict[str, float | None]]]) -> None:
    asset, model, metrics = report["asset"], report["model"], report["metrics"]
    rows: list[tuple[str, object]] = [
        ("watermarks", len(report["watermarks"])),
        ("faces", f"{asset['faces']:,} -> {model['faces']:,}"),
        ("watertight", f"{asset['watertight']} -> {model['watertight']}"),
    ]
    rows += [
        (name, value) for group in ("watermark_quality", "asset_utility") for name, value in metrics[group].items()
    ]
    rows += [(f"seconds {stage}", value) for stage, value in report["timings"].items()]
    for name, value in rows:
        if value is not None:
            print(f"  {name:20} {f'{value:.4g}' if isinstance(value, float) else value}")
    print()


if __name__ == "__main__":
    sys.exit(main())
