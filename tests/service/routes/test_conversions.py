"""Conversions over HTTP: an asset of any format as a plain GLB, of which nothing stays."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from httpx2 import Response
from sqlalchemy import update

from core.gltf.document import Document
from core.gltf.scene import scene_of
from service.config import Settings
from service.jobs.clock import now
from service.jobs.models import Job, Lease
from service.jobs.tenants import Scope, create_key
from tests.core.formats.samples import GLB, OFF
from tests.core.gltf.compressed import draco
from tests.service.conftest import Client, client_with
from tests.service.routes.test_watermarks import HUGE_ACCESSOR, glb, refused
from tests.worker.engines import asset
from worker.sweeper import remove_expired

PLACE = "/v1/conversions"
POINTS = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """A service whose worker starts once for several tests."""
    with client_with(Settings(data_dir=tmp_path_factory.mktemp("served"))) as client:
        yield client


@pytest.fixture
def keyed(tmp_path: Path) -> Iterator[Client]:
    """A service where clients have keys, and may have one job at a time and few bytes."""
    settings = Settings(data_dir=tmp_path, auth="keys", max_active_jobs=1, max_stored_bytes=2000, requests_per_minute=5)
    with client_with(settings) as client:
        yield client


def post(client: Client, content: bytes = OFF, name: str = "cube.off", **more: Any) -> Response:
    return client.http.post(PLACE, files={"file": (name, content)}, **more)


def converted(client: Client, content: bytes, name: str) -> Document:
    """The asset as the service gives it back."""
    place = post(client, content, name).headers["Location"]
    client.run(place)
    job = client.http.get(place).json()
    assert job["state"] == "succeeded", job
    return Document.from_glb(client.http.get(job["links"]["model"]).content)


def test_an_asset_becomes_a_plain_glb_and_is_gone(served: Client) -> None:
    before = set(served.artifacts.listing())
    response = post(served)
    job, place = response.json(), response.headers["Location"]
    assert (response.status_code, place) == (202, f"{PLACE}/{job['id']}")
    assert (job["state"], job["input"]["filename"], job["links"]) == (
        "queued",
        "cube.off",
        {"self": place, "model": None},
    )
    served.run(place)
    done = served.http.get(place).json()
    assert (done["state"], done["input"], done["links"]["model"]) == ("succeeded", None, f"{place}/model")
    model = served.http.get(f"{place}/model")
    assert model.headers["Content-Type"] == "model/gltf-binary"
    assert model.headers["Content-Disposition"] == 'attachment; filename="cube.plain.glb"'
    assert len(scene_of(model.content).surface.faces) == 12
    assert len(set(served.artifacts.listing()) - before) == 1, "the asset is gone"
    assert served.http.delete(place).status_code == 204
    assert set(served.artifacts.listing()) == before


def test_compressed_geometry_comes_back_plain(served: Client) -> None:
    compressed = draco(Document.from_glb(GLB))
    document = converted(served, compressed.to_glb(), "cube.glb")
    assert not {"extensionsUsed", "extensionsRequired"} & document.json.keys()


def test_what_the_process_that_reads_it_finds_wrong_is_said(served: Client) -> None:
    document = draco(Document.from_glb(GLB))
    [primitive] = document.json["meshes"][0]["primitives"]
    view = document.json["bufferViews"][primitive["extensions"]["KHR_draco_mesh_compression"]["bufferView"]]
    damaged = bytearray(document.binary)
    damaged[view["byteOffset"] + 20 :] = bytes(len(damaged) - view["byteOffset"] - 20)
    document.binary = bytes(damaged)
    response = post(served, document.to_glb(), "cube.glb")
    assert response.status_code == 202, "the gate reads headers alone"
    served.run(response.headers["Location"])
    job = served.http.get(response.headers["Location"]).json()
    assert (job["state"], job["error"]["code"]) == ("failed", "malformed_file")
    assert served.http.get(f"{job['links']['self']}/model").json()["code"] == "job_failed"


@pytest.mark.parametrize(
    ("content", "status", "code"),
    [
        (b"", 422, "empty_file"),
        (b"hello", 415, "unknown_format"),
        (POINTS, 422, "no_faces"),
        (glb(HUGE_ACCESSOR), 422, "budget_exceeded"),
    ],
)
def test_the_gate_refuses_what_it_refuses_of_watermarks(client: Client, content: bytes, status: int, code: str) -> None:
    refused(client, post(client, content, "asset"), status, code)


def test_a_request_without_a_file_is_told_so(client: Client) -> None:
    refused(client, client.http.post(PLACE, files={"else": ("cube.off", OFF)}), 422, "missing_file")


def test_it_is_on_no_list_and_no_other_kind_of_job(client: Client) -> None:
    place = post(client).headers["Location"]
    job_id = place.rpartition("/")[2]
    for kind in ("watermarks", "verifications"):
        assert client.http.get(f"/v1/{kind}").json()["items"] == []
        assert client.http.get(f"/v1/{kind}/{job_id}").status_code == 404
    assert client.http.get(f"{PLACE}/{client.submit().rpartition('/')[2]}").status_code == 404


def test_it_goes_before_the_tenants_other_jobs(served: Client) -> None:
    waiting, place = served.submit(), post(served).headers["Location"]
    served.run(waiting)  # the message of one job: the worker takes the job whose turn it is
    assert [served.http.get(each).json()["state"] for each in (waiting, place)] == ["queued", "succeeded"]


@pytest.mark.parametrize(("retention", "seconds"), [(0, 3600), (600, 600), (7200, 3600)])
def test_nothing_of_it_is_kept_for_longer_than_an_hour(tmp_path: Path, retention: int, seconds: int) -> None:
    with client_with(Settings(data_dir=tmp_path, retention_seconds=retention)) as client:
        place = post(client, name="secret name.off").headers["Location"]
        ledger = client.worker.ledger
        job_id = place.rpartition("/")[2]
        claimed = ledger.claim(job_id, 60)
        assert claimed
        assert ledger.succeed(Lease(job_id, claimed.lease_token))
        job = ledger.get(job_id)
        assert job
        assert job.expires_at
        assert job.finished_at
        assert (job.expires_at - job.finished_at).total_seconds() == seconds
        with ledger.sessions.begin() as session:
            session.execute(update(Job).values(purge_at=now()))
        remove_expired(client.worker)
        job = ledger.get(job_id)
        assert job
        assert "secret" not in job.filename


def test_it_counts_against_the_limits_of_its_tenant(keyed: Client) -> None:
    sessions = keyed.worker.ledger.sessions
    keys = (create_key(sessions, "acme", "a", Scope), create_key(sessions, "beta", "b", Scope))
    headers, other = [{"Authorization": f"Bearer {key.text}"} for key in keys]
    first = post(keyed, headers=headers)
    assert first.status_code == 202, first.text
    assert post(keyed, headers=headers).json()["code"] == "too_many_jobs"
    place = first.headers["Location"]
    assert keyed.http.get(place, headers=other).status_code == 404
    assert keyed.http.delete(place, headers=headers).status_code == 204
    big = asset() + b"# " + b"-" * 2000
    assert post(keyed, big, headers=headers).json()["code"] == "quota_exceeded"
    assert post(keyed, headers=headers).status_code == 202
    assert post(keyed, headers=headers).json()["code"] == "rate_limited"
    assert post(keyed).json()["code"] == "invalid_api_key"
