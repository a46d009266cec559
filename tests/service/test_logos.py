"""Logos, QR codes and labels go the whole way over HTTP: API, Redis, worker and the engine, each a process of its own.

What stands on the result is looked at from outside: by the heights at which rays meet the surface of the file.
"""

import io
import json
import sys
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from core.arrays import Float
from tests.service.harness import API_COMMAND, Service, redis_server

WORKER = [sys.executable, "-m", "celery", "-A", "worker.app", "worker"]
PLATE = trimesh.creation.box(extents=(30.0, 16.0, 2.0)).export(file_type="stl")
# A disc with a hole of half its width, which takes a quarter of it.
DISCS = "M4 0a4 4 0 0 1 0 8a4 4 0 0 1 0-8zM4 2a2 2 0 0 1 0 4a2 2 0 0 1 0-4z"
RING = (
    f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 8 8'><path fill-rule='evenodd' d='{DISCS}'/></svg>".encode()
)
ADDRESS = "https://a.example/4711"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("logos")
    with redis_server(folder) as broker:
        service = Service(folder, broker_url=broker, lease_seconds="15")
        with service.running(API_COMMAND, WORKER):
            yield service


def result(service: Service, files: dict[str, Any] | None = None, **asked: object) -> tuple[trimesh.Trimesh, Any]:
    """The model and the report of a job."""
    response = service.submit(PLATE, json.dumps({"count": 1, "evaluate": "none"} | asked), **(files or {}))
    assert response.status_code == 202, response.text
    links = service.wait_for(response.headers["Location"], "succeeded")["links"]
    model = service.client.get(links["model"]).content
    return trimesh.load_mesh(io.BytesIO(model), file_type="glb"), service.client.get(links["report"]).json()


def reliefs(model: trimesh.Trimesh, mark: Any, *, rows: int) -> Float:
    """Heights of the surface in the box of a mark, in its reliefs, as a picture."""
    width, height, depth = mark["size"]
    columns = round(rows * width / height)
    x, y = (((np.arange(count) + 0.5) / count - 0.5) * length for count, length in ((columns, width), (rows, height)))
    right, up, normal, center = (np.array(mark[name]) for name in ("right", "up", "normal", "center"))
    places = center + x[None, :, None] * right + y[::-1, None, None] * up
    start = (places + (depth + mark["relief"]) * normal).reshape(-1, 3)
    points, rays, _ = model.ray.intersects_location(start, np.tile(-normal, (len(start), 1)), multiple_hits=False)
    level = np.full(len(start), np.nan)
    level[rays] = (points - center) @ normal
    ground = np.nanmin(level)
    return np.asarray(((level - ground) / mark["relief"]).reshape(rows, columns))


def test_a_label_comes_in_words_and_in_the_metadata_or_in_these_alone(service: Service) -> None:
    declared = {"creator": "Example Ltd", "aigc": {"content_producer": "Example Ltd", "produce_id": "47"}}
    _, report = result(service, label="cn", declaration=declared)
    assert [mark["text"] for mark in report["watermarks"]] == ["AI生成"]
    assert report["label"]["aigc"] == "written"
    bare, report = result(service, label="cn", declaration=declared, metadata_only=True)
    assert (report["watermarks"], report["label"]["aigc"], len(bare.faces)) == ([], "written", 12)


def test_a_logo_with_a_hole_stands_beside_a_text(service: Service) -> None:
    model, report = result(service, {"logo": ("logo.svg", RING)}, text="HI", profile="flat")
    (mark,) = report["watermarks"]
    assert (mark["logo"], mark["text"], mark["lines"]) == ("svg", "HI", ["HI"])
    assert mark["drawn"]
    heights = reliefs(model, mark, rows=64)
    ring = heights[:, :64]
    y, x = (np.indices((64, 64)) + 0.5) / 64 - 0.5
    far = np.hypot(x, y)
    assert ring[(far > 0.31) & (far < 0.44)].min() > 0.9, "the ring is raised, between its slopes"
    assert ring[(far < 0.24) | (far > 0.51)].max() < 0.1, "the hole and what is round it are not"
    raised = (heights[:, 64:] > 0.9).astype(int)
    strokes = (np.diff(raised, axis=1) == 1).sum(axis=1)
    assert strokes[[20, 32, 44]].tolist() == [3, 2, 3], "above and below the bar of H, and across it; then I"


def test_a_qr_code_that_was_asked_for_can_be_read_from_the_result(service: Service) -> None:
    model, report = result(service, qr=ADDRESS)
    (mark,) = report["watermarks"]
    assert (mark["logo"], mark["text"], mark["lines"]) == ("qr", "", [])
    assert mark["color"] is not None
    assert report["warnings"] == []
    picture = np.where(reliefs(model, mark, rows=400) > 0.5, 0, 255).astype(np.uint8)
    assert cv2.QRCodeDetector().detectAndDecode(np.pad(picture, 40, constant_values=255))[0] == ADDRESS
