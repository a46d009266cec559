import json
import struct
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from httpx2 import Response
from sqlalchemy import update

from core.formats.zip_write import zip_of
from service.config import Settings
from service.exports import HEAD, kind_of
from service.jobs import queue
from service.jobs.clock import now
from service.jobs.models import ArtifactKind, Job, Queue
from tests.service.conftest import Client, client_with
from tests.worker.engines import asset
from worker.sweeper import remove_expired


def post(client: Client, **request: Any) -> Response:
    request.setdefault("data", {"params": '{"text": "HI"}'})
    request.setdefault("files", {"file": ("asset.obj", asset())})
    return client.http.post("/v1/watermarks", **request)


def stored(client: Client) -> list[str]:
    return [item.sha256 for item in client.artifacts.listing()]


def refused(client: Client, response: Response, status: int, code: str) -> dict[str, Any]:
    assert response.status_code == status, response.text
    assert response.headers["Content-Type"] == "application/problem+json"
    problem = dict(response.json())
    assert set(problem) == {"type", "title", "status", "detail", "code", "remedy"}
    assert (problem["status"], problem["code"]) == (status, code)
    assert problem["detail"].endswith(".")
    assert problem["remedy"].endswith(".")
    assert stored(client) == []
    assert queue.depth(client.worker.celery, Queue.SMALL) == 0
    return problem


def test_an_accepted_asset_is_a_queued_job_at_its_location(client: Client) -> None:
    response = post(client)
    job = response.json()
    assert response.status_code == 202
    assert response.headers["Location"] == f"/v1/watermarks/{job['id']}" == job["links"]["self"]
    assert (job["state"], job["stage"], job["progress"], job["error"]) == ("queued", None, 0, None)
    assert job["parameters"]["text"] == "HI"
    assert job["input"]["filename"] == "asset.obj"
    assert job["created_at"].endswith("Z")
    assert datetime.fromisoformat(job["created_at"]).tzinfo is not None
    assert client.http.get(response.headers["Location"]).json() == job
    assert queue.depth(client.worker.celery, Queue.SMALL) == 1


def glb(text: bytes, version: int = 2) -> bytes:
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIIII", b"glTF", version, 20 + len(text), len(text), 0x4E4F534A) + text


HUGE_ACCESSOR = (
    b'{"asset":{"version":"2.0"},"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"accessors":'
    b'[{"componentType":5126,"type":"VEC3","count":100000000,"min":[0,0,0],"max":[1,1,1]}]}'
)


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"", "empty_file"),
        (b"Dear sir or madam, this is a letter.", "unknown_format"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no_faces"),
        (b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 50, "truncated_file"),
        (glb(HUGE_ACCESSOR)[:-30], "truncated_file"),
        (glb(HUGE_ACCESSOR), "budget_exceeded"),
    ],
)
def test_a_file_that_is_visibly_broken_is_refused_at_once(client: Client, content: bytes, code: str) -> None:
    response = post(client, files={"file": ("asset.glb", content)})
    refused(client, response, 415 if code == "unknown_format" else 422, code)


@pytest.mark.parametrize(
    ("params", "code", "named"),
    [
        ("{}", "empty_text", "empty"),
        ("not json", "invalid_parameters", "JSON"),
        ("[]", "invalid_parameters", "object"),
        ('{"text": ""}', "empty_text", "empty"),
        ('{"text": "   "}', "empty_text", "spaces"),
        ('{"text": "HI", "size": -1}', "invalid_parameters", "size"),
        ('{"text": "HI", "relief": NaN}', "invalid_parameters", "relief"),
        ('{"text": "HI", "colour": "#ff0000"}', "invalid_parameters", "colour"),
        ('{"text": "HI", "count": 1000}', "invalid_parameters", "count"),
        ('{"text": "HI", "keep_out": [{"node": ""}]}', "invalid_parameters", "keep_out.0.node"),
        ('{"text": "HI", "seed": 9223372036854775808}', "invalid_parameters", "seed"),
        ('{"text": "' + "A" * 201 + '"}', "invalid_parameters", "200"),
        ('{"text": "\U0001f984"}', "missing_glyphs", "U+1F984"),
    ],
)
def test_wrong_parameters_are_refused_and_the_problem_names_them(
    client: Client, params: str, code: str, named: str
) -> None:
    assert named in refused(client, post(client, data={"params": params}), 422, code)["detail"]


def test_a_request_without_a_file_is_refused(client: Client) -> None:
    refused(client, post(client, files={"other": ("a", b"1")}), 422, "missing_file")
    refused(client, post(client, files=None), 422, "missing_file")


def test_a_request_without_parameters_is_refused(client: Client) -> None:
    assert "params" in refused(client, post(client, data={}), 400, "invalid_request")["detail"]


def test_a_text_field_in_place_of_the_file_is_refused(client: Client) -> None:
    refused(client, post(client, data={"params": '{"text": "HI"}', "file": "abc"}, files=None), 422, "missing_file")


def test_a_body_that_is_no_form_is_refused(client: Client) -> None:
    response = client.http.post("/v1/watermarks", json={"text": "HI"})
    assert "application/json" in refused(client, response, 415, "unsupported_media_type")["detail"]
    broken = {"Content-Type": "multipart/form-data; boundary=x"}
    refused(client, client.http.post("/v1/watermarks", content=b"--y\r\nno", headers=broken), 400, "invalid_request")
    unbounded = {"Content-Type": "multipart/form-data"}
    refused(client, client.http.post("/v1/watermarks", content=b"--y", headers=unbounded), 400, "invalid_request")


def test_too_many_or_too_large_parts_are_refused(client: Client) -> None:
    four = [(name, (name, b"1")) for name in ("file", "file", "font", "logo")]
    refused(client, post(client, files=four), 400, "invalid_request")
    refused(client, post(client, data=dict.fromkeys("abcdefgh", "{}")), 400, "invalid_request")
    refused(client, post(client, data={"params": " " * 70_000}), 400, "invalid_request")
    refused(client, post(client, data={"params": "{}", "copies": " " * 1_100_000}), 400, "invalid_request")


def test_a_file_over_the_limit_is_refused(client: Client) -> None:
    refused(client, post(client, files={"file": ("a.obj", b"v" * 100_001)}), 413, "upload_too_large")


def test_a_request_that_declares_too_much_is_refused_by_its_header(client: Client) -> None:
    response = client.http.post("/v1/watermarks", content=b"", headers={"Content-Length": str(10**12)})
    refused(client, response, 413, "upload_too_large")
    assert response.headers["Connection"] == "close"


def test_a_request_that_declares_nothing_is_refused_while_it_streams(client: Client) -> None:
    sent = 0

    def endless() -> Any:
        nonlocal sent
        yield b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.obj"\r\n\r\n'
        while sent < 50:
            sent += 1
            yield b"v" * 100_000

    headers = {"Content-Type": "multipart/form-data; boundary=x"}
    response = client.http.post("/v1/watermarks", content=endless(), headers=headers)
    refused(client, response, 413, "upload_too_large")


def test_a_broken_font_is_refused(client: Client) -> None:
    parts = {"file": ("asset.obj", asset()), "font": ("font.ttf", b"\0\1\0\0garbage")}
    refused(client, post(client, files=parts), 422, "invalid_font")
    parts = {"file": ("asset.obj", asset()), "font": ("font.ttf", b"\0" * 50_001)}
    refused(client, post(client, files=parts), 413, "upload_too_large")


@pytest.mark.parametrize("part", ["", "/model", "/report", "/preview"])
def test_an_unknown_job_is_not_found(client: Client, part: str) -> None:
    refused(client, client.http.get(f"/v1/watermarks/nothing{part}"), 404, "not_found")
    refused(client, client.http.delete("/v1/watermarks/nothing"), 404, "not_found")


def test_results_are_delivered_with_type_name_and_hash(client: Client) -> None:
    url = client.submit(name="../../My Asset é.obj")
    client.run(url)
    model = client.http.get(f"{url}/model")
    assert model.content == b"glTF of HI"
    assert model.headers["Content-Type"] == "model/gltf-binary"
    assert "My%20Asset%20%C3%A9.watermarked.glb" in model.headers["Content-Disposition"]
    job = client.worker.ledger.get(url.rsplit("/", 1)[1])
    assert job is not None
    artifact = job.artifact(ArtifactKind.MODEL)
    assert artifact is not None
    assert model.headers["ETag"] == f'"{artifact.sha256}"'
    assert client.http.get(f"{url}/report").headers["Content-Type"] == "application/json"
    assert client.http.get(f"{url}/preview").headers["Content-Type"] == "image/png"


def test_another_format_comes_where_it_was_asked_for_with_its_own_ending_and_media_type(client: Client) -> None:
    url = client.submit(params='{"text": "HI", "format": "ply"}')
    client.run(url)
    assert client.http.get(url).json()["links"]["export"] == f"{url}/export"
    found = client.http.get(f"{url}/export")
    assert (found.content, found.headers["Content-Type"]) == (b"ply\n", "model/ply")
    assert ".watermarked.ply" in found.headers["Content-Disposition"]
    assert client.http.head(f"{url}/export").headers["ETag"] == found.headers["ETag"]
    assert client.http.get(f"{url}/model").content.startswith(b"glTF"), "the GLB is made as well"
    url = client.submit()
    client.run(url)
    assert client.http.get(url).json()["links"]["export"] is None
    assert client.http.get(f"{url}/export").json()["code"] == "not_found"
    assert client.http.post("/v1/watermarks", data={"params": '{"text": "HI", "format": "step"}'}).status_code == 422


@pytest.mark.parametrize(
    ("head", "ending"),
    [
        (b"ply\nformat binary_little_endian 1.0", ".ply"),
        (b"COFF\n8 12 0\n", ".off"),
        (b"meshmark".ljust(80), ".stl"),
        (zip_of({"[Content_Types].xml": b"", "3D/3dmodel.model": b""}), ".3mf"),
        (zip_of({"model.obj": b"", "model.mtl": b""}), ".zip"),
    ],
)
def test_a_written_file_tells_its_kind_by_its_first_bytes(head: bytes, ending: str) -> None:
    assert kind_of(head[:HEAD]).ending == ending


def test_a_turntable_and_a_poster_come_where_they_were_asked_for(client: Client) -> None:
    url = client.submit(params='{"text": "HI", "turntable": true}')
    client.run(url)
    for part in ("turntable", "poster"):
        assert client.http.get(url).json()["links"][part] == f"{url}/{part}"
        found = client.http.get(f"{url}/{part}")
        assert (found.content, found.headers["Content-Type"]) == (b"RIFF", "image/webp")
        assert f".watermarked.{part}.webp" in found.headers["Content-Disposition"]
        assert client.http.head(f"{url}/{part}").headers["ETag"] == found.headers["ETag"]
    url = client.submit()
    client.run(url)
    assert client.http.get(url).json()["links"]["turntable"] is None
    assert client.http.get(f"{url}/turntable").json()["code"] == "not_found"


def test_a_light_model_comes_where_it_was_asked_for(client: Client) -> None:
    url = client.submit(params='{"text": "HI", "preview_model": {"triangles": 5000}}')
    client.run(url)
    job = client.http.get(url).json()
    assert job["links"]["preview_model"] == f"{url}/preview_model"
    assert job["parameters"]["preview_model"] == {"triangles": 5000, "texture": 512, "alone": False}
    found = client.http.get(job["links"]["preview_model"])
    assert (found.content, found.headers["Content-Type"]) == (b"glTF in little", "model/gltf-binary")
    assert ".watermarked.preview.glb" in found.headers["Content-Disposition"]
    url = client.submit()
    client.run(url)
    assert client.http.get(url).json()["links"]["preview_model"] is None
    assert client.http.get(f"{url}/preview_model").json()["code"] == "not_found"


def test_why_marks_stand_where_they_stand_is_told_where_it_was_asked_for(client: Client) -> None:
    url = client.submit(params='{"text": "HI", "explain": true}')
    client.run(url)
    links = client.http.get(url).json()["links"]
    assert client.http.get(links["explanation"]).headers["Content-Type"] == "application/json"
    layers = client.http.get(links["layers"])
    assert (layers.content, layers.headers["Content-Type"]) == (b"glTF of layers", "model/gltf-binary")
    assert ".watermarked.explanation.glb" in layers.headers["Content-Disposition"]


def test_a_client_that_has_the_model_is_not_sent_it_again(client: Client) -> None:
    url = client.submit()
    client.run(url)
    tag = client.http.get(f"{url}/model").headers["ETag"]
    again = client.http.get(f"{url}/model", headers={"If-None-Match": tag})
    assert (again.status_code, again.content, again.headers["ETag"]) == (304, b"", tag)
    assert client.http.get(f"{url}/model", headers={"If-None-Match": '"other"'}).status_code == 200


def test_a_part_of_the_model_can_be_fetched(client: Client) -> None:
    url = client.submit()
    client.run(url)
    part = client.http.get(f"{url}/model", headers={"Range": "bytes=0-3"})
    assert (part.status_code, part.content) == (206, b"glTF")


def test_results_of_a_waiting_job_are_not_ready(client: Client) -> None:
    response = client.http.get(f"{client.submit()}/model")
    assert (response.status_code, response.json()["code"], response.headers["Retry-After"]) == (409, "not_ready", "1")


def test_a_failed_job_tells_why(client: Client) -> None:
    url = client.submit(asset("refuse"))
    client.run(url)
    assert client.http.get(url).json()["error"] == {
        "code": "no_placement",
        "title": "No placement",
        "detail": "No place on this asset.",
        "remedy": "Ask for smaller letters.",
    }
    problem = client.http.get(f"{url}/model").json()
    assert problem["code"] == "job_failed"
    assert "No place on this asset." in problem["detail"]


def test_a_deleted_waiting_job_never_runs(client: Client) -> None:
    url = client.submit()
    assert client.http.delete(url).status_code == 204
    client.run(url)
    job = client.http.get(url).json()
    assert (job["state"], job["attempts"], job["input"]) == ("canceled", 0, None)
    assert stored(client) == []


def test_a_deleted_result_is_gone_and_the_job_expired(client: Client) -> None:
    url = client.submit()
    client.run(url)
    assert client.http.delete(url).status_code == 204
    assert stored(client) == []
    job = client.http.get(url).json()
    assert (job["state"], job["links"]["model"]) == ("expired", None)
    response = client.http.get(f"{url}/model")
    assert (response.status_code, response.json()["code"]) == (410, "job_expired")


def test_a_job_expires_when_its_time_is_over(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, retention_seconds=1000)) as client:
        failed, url = client.submit(asset("refuse")), client.submit()
        assert client.http.get(url).json()["expires_at"] is None
        client.run(failed)
        client.run(url)
        job = client.http.get(url).json()
        until = datetime.fromisoformat(job["expires_at"]) - datetime.fromisoformat(job["finished_at"])
        assert until.total_seconds() == 1000
        remove_expired(client.worker)
        assert client.http.get(f"{url}/model").status_code == 200
        with client.worker.ledger.sessions.begin() as session:
            session.execute(update(Job).values(purge_at=now()))
        remove_expired(client.worker)
        for part in ("model", "report", "preview"):
            answer = client.http.get(f"{url}/{part}")
            assert (answer.status_code, answer.json()["code"]) == (410, "job_expired")
        assert client.http.get(url).json()["state"] == "expired"
        assert client.http.get(failed).json()["error"]["code"] == "no_placement"
        assert stored(client) == []


def test_deleting_one_of_two_jobs_with_the_same_asset_keeps_the_others_files(client: Client) -> None:
    first, second = client.submit(), client.submit()
    client.run(first)
    client.run(second)
    assert len(stored(client)) == 5  # asset, model, plan, report, preview: each content once
    client.http.delete(first)
    assert client.http.get(f"{second}/model").content == b"glTF of HI"
    client.http.delete(second)
    assert stored(client) == []


def test_metadata_is_given_back_and_finds_the_job(client: Client) -> None:
    notes = {"order": "4711", "shop": "Nord ä"}
    job = post(client, data={"params": '{"text": "HI"}', "metadata": json.dumps(notes)}).json()
    client.submit()
    assert job["metadata"] == notes
    assert client.http.get(job["links"]["self"]).json()["metadata"] == notes
    found = client.http.get("/v1/watermarks", params={"metadata": "shop:Nord ä"}).json()
    assert (found["items"], found["next"]) == ([job], None)
    assert post(client, data={"params": '{"text": "HI"}', "metadata": "[]"}).json()["code"] == "invalid_metadata"


def test_the_list_of_jobs_is_walked_by_its_links(client: Client) -> None:
    urls = [client.submit() for _ in range(5)]
    client.http.delete(urls[0])
    here: str | None = "/v1/watermarks?state=queued&limit=3"
    pages = []
    while here:
        page = client.http.get(here).json()
        pages.append([job["links"]["self"] for job in page["items"]])
        here = page["next"]
    assert pages == [urls[:1:-1], urls[1:2]]


def test_jobs_are_listed_by_the_moment_they_were_sent(client: Client) -> None:
    first, second = (client.http.get(client.submit()).json() for _ in range(2))
    after = client.http.get("/v1/watermarks", params={"created_after": first["created_at"]}).json()["items"]
    before = client.http.get("/v1/watermarks", params={"created_before": second["created_at"]}).json()["items"]
    assert (after, before) == ([second], [first])


@pytest.mark.parametrize(
    ("query", "code", "named"),
    [
        ("state=done", "invalid_request", "state"),
        ("limit=0", "invalid_request", "limit"),
        ("limit=101", "invalid_request", "limit"),
        ("created_after=yesterday", "invalid_request", "created_after"),
        ("created_after=2026-01-31T12:00:00", "invalid_request", "created_after"),
        ("created_after=0.5", "invalid_request", "created_after"),
        ("created_after=1769860800", "invalid_request", "created_after"),
        ("created_after=0001-01-01T00:00:00%2B14:00", "invalid_request", "created_after"),
        ("cursor=nothing", "invalid_request", "cursor"),
        ("metadata=order", "invalid_metadata", "metadata"),
        ("metadata=order:%00", "invalid_metadata", "metadata"),
    ],
)
def test_a_list_of_what_cannot_be_is_refused(client: Client, query: str, code: str, named: str) -> None:
    status = 422 if code == "invalid_metadata" else 400
    assert named in refused(client, client.http.get(f"/v1/watermarks?{query}"), status, code)["detail"]


def test_a_tenant_who_has_too_many_jobs_waits_and_leaves_nothing(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, max_active_jobs=1)) as client:
        url = client.submit()
        response = post(client, files={"file": ("asset.obj", asset("other"))}, headers={"Idempotency-Key": "a"})
        assert (response.status_code, response.json()["code"]) == (429, "too_many_jobs")
        assert int(response.headers["Retry-After"]) > 0
        assert len(stored(client)) == 1
        client.run(url)
        response = post(client, files={"file": ("asset.obj", asset("other"))}, headers={"Idempotency-Key": "a"})
        assert response.status_code == 202
        assert "Idempotent-Replayed" not in response.headers


def test_jobs_wait_by_size_and_have_a_priority(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, large_asset_bytes=1000)) as client:
        large = asset() + b"#" * 1000 + b"\n"
        sent = {"file": ("asset.obj", large)}, {"params": '{"text": "HI"}', "priority": "high"}
        response = client.http.post("/v1/watermarks", files=sent[0], data=sent[1])
        assert (response.status_code, response.json()["priority"]) == (202, "high")
        assert [queue.depth(client.worker.celery, each) for each in Queue] == [0, 1, 0]
        url = client.submit()
        assert client.http.get(url).json()["priority"] == "normal"
        client.run(url)
        assert client.http.get(response.headers["Location"]).json()["state"] == "queued"
        client.run(response.headers["Location"])
        assert client.http.get(response.headers["Location"]).json()["state"] == "succeeded"
        refused = client.http.post("/v1/watermarks", files=sent[0], data=sent[1] | {"priority": "urgent"})
        assert (refused.status_code, refused.json()["code"]) == (400, "invalid_request")
