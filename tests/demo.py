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

ASSET = Path(__file__).parent / "data" / "spot.glb"
OUTPUT = Path("demo-output")
START_TIMEOUT = 60.0


def main() -> int:
    """Watermarks the demo asset; returns 0 when model, report and preview lie in ``demo-output``."""
    OUTPUT.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as data, _service(Path(data)) as client:
        print(f"The service answers at {client.base_url}. Uploading {ASSET.name} ({ASSET.stat().st_size:,} bytes).")
        started = time.monotonic()
        with ASSET.open("rb") as asset:
            answer = client.post(
                "/v1/watermarks",
                files={"file": (ASSET.name, asset)},
                data={"params": json.dumps({"text": "watermark", "color": "#d02020"})},
            )
        answer.raise_for_status()
        job = answer.json()
        shown = ""
        while job["state"] in ("queued", "running"):
            line = f"  {job['progress']:4.0%} {job['stage'] or job['state']}"
            if line != shown:
                print(line, flush=True)
                shown = line
            time.sleep(0.1)
            job = client.get(job["links"]["self"]).json()
        print(f"  {job['state']} after {time.monotonic() - started:.1f} s\n")
        if job["state"] != "succeeded":
            print(json.dumps(job["error"], indent=2))
            return 1
        paths = {
            kind: OUTPUT / name
            for kind, name in (("model", "spot.glb"), ("report", "report.json"), ("preview", "preview.png"))
        }
        for kind, path in paths.items():
            path.write_bytes(client.get(job["links"][kind]).raise_for_status().content)
    _print_report(json.loads(paths["report"].read_text()))
    for kind, path in paths.items():
        print(f"  {kind:8} {path.resolve()}")
    return 0


@contextmanager
def _service(data: Path) -> Iterator[httpx2.Client]:
    """The embedded service on a free port, up and answering."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    environment = os.environ | {
        "MESHMARK_PORT": str(port),
        "MESHMARK_DATA_DIR": str(data / "data"),
        "MESHMARK_LOG_LEVEL": "WARNING",
    }
    process = subprocess.Popen([sys.executable, "-m", "service"], env=environment)
    try:
        with httpx2.Client(base_url=f"http://127.0.0.1:{port}", timeout=30) as client:
            deadline = time.monotonic() + START_TIMEOUT
            while True:
                try:
                    client.get("/healthz").raise_for_status()
                    break
                except httpx2.HTTPError:
                    if process.poll() is not None or time.monotonic() > deadline:
                        raise
                    time.sleep(0.1)
            yield client
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
