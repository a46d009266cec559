"""Assets that a client names by their address, fetched by a real worker from real servers."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import ip_network
from pathlib import Path
from typing import Any

import pytest
from httpx2 import Response

from core.artwork.fonts import DEFAULT_FONT
from service.config import Settings
from service.jobs import contents, sources
from service.jobs.dead import WORKER_LOST
from service.jobs.models import ArtifactKind
from tests.service.conftest import Client, client_with
from tests.service.outbound.servers import LOOPBACK, Script, Server, read_request, replying, response, serving
from tests.service.s3 import S3, bucket_settings
from tests.worker.engines import asset
from tests.worker.waiting import PATIENCE, wait_until
from worker.sweeper import sweep
from worker.template import Template

SECRET = "X-Signature=0123456789abcdef"

LOGO = b"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 9 9'><path d='M0 0h9v9z'/></svg>"


def allowing(*servers: Server, **more: Any) -> dict[str, Any]:
    """Settings under which these servers on loopback may be asked."""
    ports = frozenset(server.port for server in servers)
    return {
        "source_urls": True,
        "outbound_networks": (ip_network(LOOPBACK),),
        "outbound_http": True,
        "outbound_ports": ports,
    } | more


@contextmanager
def client_of(server: Server, folder: Path, **more: Any) -> Iterator[Client]:
    with client_with(Settings(data_dir=folder, **allowing(server, **more))) as client:
        yield client


def address(server: Server, path: str = f"/shop/My%20Asset.obj?{SECRET}") -> str:
    return f"http://127.0.0.1:{server.port}{path}"


def post(client: Client, url: str, key: str | None = None, **files: Any) -> Response:
    headers = {"Idempotency-Key": key} if key else {}
    data = {"params": '{"text": "HI"}', "source_url": url}
    return client.http.post("/v1/watermarks", data=data, files=files or None, headers=headers)


def failure(script: Script, folder: Path, **more: Any) -> dict[str, Any]:
    """The error of a job whose asset is at a server."""
    with serving(script) as server, client_of(server, folder, **more) as client:
        url = post(client, address(server)).headers["Location"]
        client.run(url)
        job = client.http.get(url).json()
        assert job["state"] == "failed"
        assert job["input"] is None
        assert SECRET not in str(job)
        assert list(client.artifacts.listing()) == []
        return dict(job["error"])


@pytest.fixture(autouse=True)
def _without_long_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worker.sources.PAUSES", (0.01, 0.01))


def test_an_asset_at_an_address_is_watermarked_as_one_that_was_sent(tmp_path: Path) -> None:
    requests: list[tuple[bytes, bytes]] = []
    with serving(replying(response(asset()), requests=requests)) as server, client_of(server, tmp_path) as client:
        accepted = post(client, address(server), font=("font.ttf", DEFAULT_FONT.read_bytes()), logo=("logo.svg", LOGO))
        assert accepted.status_code == 202
        assert accepted.json()["input"] is None
        assert requests == [], "the client is answered before anything is fetched"
        url = accepted.headers["Location"]
        client.run(url)
        job = client.http.get(url).json()
        assert (job["state"], job["attempts"]) == ("succeeded", 1)
        assert (job["input"]["filename"], job["input"]["size"]) == ("My Asset.obj", len(asset()))
        assert client.http.get(job["links"]["model"]).content == b"glTF of HI"
        assert client.http.get(job["links"]["report"]).json()["font"] is True
        assert client.http.get(job["links"]["report"]).json()["logo"] is True
        assert requests[0][0].startswith(f"GET /shop/My%20Asset.obj?{SECRET} HTTP/1.1".encode())
        assert len(requests) == 1


def test_the_address_is_in_no_answer_and_no_log_and_is_forgotten(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with serving(replying(response(asset("refuse")))) as server, client_of(server, tmp_path) as client:
        accepted = post(client, address(server))
        url = accepted.headers["Location"]
        client.run(url)
        job_id = url.rsplit("/", 1)[1]
        sessions = client.worker.ledger.sessions
        assert sources.url_of(sessions, job_id) == address(server)
        sweep(client.worker)
        assert sources.url_of(sessions, job_id) is None
        answers = accepted.text + client.http.get(url).text + client.http.get("/v1/watermarks").text
    assert SECRET not in answers
    printed = capfd.readouterr()
    assert "job failed" in printed.out + printed.err
    assert SECRET not in printed.out + printed.err


def test_the_address_of_a_waiting_job_is_kept_and_that_of_a_cancelled_one_is_not(tmp_path: Path) -> None:
    with serving(replying(response(asset()))) as server, client_of(server, tmp_path) as client:
        waiting, canceled = (post(client, address(server)).json()["id"] for _ in range(2))
        client.http.delete(f"/v1/watermarks/{canceled}")
        sweep(client.worker)
        sessions = client.worker.ledger.sessions
        assert sources.url_of(sessions, waiting)
        assert sources.url_of(sessions, canceled) is None


def test_addresses_are_refused_unless_the_operator_allows_them(client: Client) -> None:
    answer = post(client, "https://files.example/asset.glb")
    assert (answer.status_code, answer.json()["code"]) == (422, "source_url_disabled")


@pytest.mark.parametrize(
    "url",
    [
        "http://files.example/a.glb",
        "https://10.0.0.1/a.glb",
        "https://[::ffff:169.254.169.254]/latest/meta-data",
        "https://2130706433/a.glb",
        "https://files.example:22/a.glb",
        "https://user:word@files.example/a.glb",
        "file:///etc/passwd",
        "a.glb",
        "https://files.example/" + "a" * 3000,
    ],
)
def test_an_address_that_cannot_be_asked_is_refused_at_once(tmp_path: Path, url: str) -> None:
    with client_with(Settings(data_dir=tmp_path, source_urls=True)) as client:
        answer = post(client, url)
        assert (answer.status_code, answer.json()["code"]) == (422, "address_refused")
        assert client.http.get("/v1/watermarks").json()["items"] == []


def test_a_name_inside_the_network_fails_the_job_as_one_that_does_not_exist(tmp_path: Path) -> None:
    with serving(replying(response(asset()))) as server:
        settings = Settings(data_dir=tmp_path, **allowing(server, outbound_networks=()))
        with client_with(settings) as client:
            errors = []
            for name in ("localhost", "files.invalid"):
                url = post(client, f"http://{name}:{server.port}/a.obj").headers["Location"]
                client.run(url)
                errors.append(client.http.get(url).json()["error"])
            assert errors[0] == errors[1]
            assert (errors[0]["code"], "no public address" in errors[0]["detail"]) == ("download_failed", True)
        assert server.connections == 0


def test_a_file_and_an_address_together_are_refused(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, source_urls=True)) as client:
        answer = post(client, "https://files.example/a.glb", file=("asset.obj", asset()))
    assert (answer.status_code, answer.json()["code"]) == (400, "invalid_request")


def test_a_server_that_fails_at_first_is_asked_again(tmp_path: Path) -> None:
    answers = [response(status="503 Service Unavailable"), b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\ncut off"]
    answers.append(response(asset()))

    def script(connection: Any) -> None:
        read_request(connection)
        connection.sendall(answers.pop(0))

    with serving(script) as server, client_of(server, tmp_path) as client:
        url = post(client, address(server)).headers["Location"]
        client.run(url)
        job = client.http.get(url).json()
        assert (job["state"], job["attempts"], server.connections) == ("succeeded", 1, 3)


def test_a_server_that_goes_on_failing_is_not_asked_for_ever(tmp_path: Path) -> None:
    asked: list[tuple[bytes, bytes]] = []
    error = failure(replying(response(status="502 Bad Gateway"), requests=asked), tmp_path)
    assert (error["code"], len(asked)) == ("download_failed", 3)
    assert "502" in error["detail"]


def test_what_will_not_change_is_asked_for_once(tmp_path: Path) -> None:
    asked: list[tuple[bytes, bytes]] = []
    error = failure(replying(response(status="404 Not Found"), requests=asked), tmp_path)
    assert (error["code"], len(asked)) == ("download_failed", 1)


def test_a_redirect_is_not_followed(tmp_path: Path) -> None:
    with serving(replying(response(asset()))) as other:
        redirect = replying(response(status="302 Found", Location=address(other)))
        assert "redirects" in failure(redirect, tmp_path)["detail"]
        assert other.connections == 0


def test_an_asset_larger_than_the_limit_fails_the_job(tmp_path: Path) -> None:
    assert failure(replying(response(b"v" * 1001)), tmp_path, max_upload_bytes=1000)["code"] == "download_too_large"


def test_an_asset_that_is_none_fails_the_job_with_the_gates_words(tmp_path: Path) -> None:
    """With the engine of the service: the tests' own looks at nothing."""
    letter = replying(response(b"Dear sir or madam, this is a letter."))
    with serving(letter) as server, client_of(server, tmp_path) as client:
        client.worker.template = Template("core.pipeline:watermark", threads=1)
        url = post(client, address(server)).headers["Location"]
        client.run(url)
        assert client.http.get(url).json()["error"]["code"] == "unknown_format"


def test_a_cancelled_job_ends_its_download(tmp_path: Path) -> None:
    stopped, dribbling = threading.Event(), threading.Event()

    def dribble(connection: Any) -> None:
        read_request(connection)
        connection.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 100000\r\n\r\n")
        try:
            while not stopped.wait(0.02):
                connection.sendall(b"v")
                dribbling.set()
        except OSError:
            stopped.set()

    with serving(dribble) as server, client_of(server, tmp_path) as client:
        url = post(client, address(server)).headers["Location"]
        thread = threading.Thread(target=client.run, args=(url,))
        thread.start()
        assert dribbling.wait(PATIENCE)
        wait_until(lambda: client.http.get(url).json()["stage"] == "fetching")
        client.http.delete(url)
        assert stopped.wait(PATIENCE)
        thread.join(PATIENCE)
        assert client.http.get(url).json()["state"] == "canceled"
        assert list(client.worker.scratch.iterdir()) == []
        assert list(client.artifacts.listing()) == []


def test_a_job_that_is_tried_again_does_not_download_again(tmp_path: Path) -> None:
    with serving(replying(response(asset()))) as server, client_of(server, tmp_path) as client:
        ledger = client.worker.ledger
        url = post(client, address(server)).headers["Location"]
        job = ledger.claim(url.rsplit("/", 1)[1], 0.01)  # by a worker that brings the asset and then dies
        assert job is not None
        path = tmp_path / "source"
        assert client.worker.sources.bring(job.id, path, lambda: None, lambda _: None)
        with path.open("rb") as file, client.artifacts.stage(file, limit=10_000, name="file") as staged:
            assert contents.publish(ledger, client.artifacts, job.lease, ArtifactKind.INPUT, staged)
        wait_until(lambda: ledger.recover(2, WORKER_LOST)[0])
        sweep(client.worker)
        assert sources.url_of(ledger.sessions, job.id) is None
        client.run(url)
        assert client.http.get(url).json()["state"] == "succeeded"
        assert server.connections == 1


def test_a_request_sent_again_is_the_same_job_and_another_address_is_another_request(tmp_path: Path) -> None:
    with serving(replying(response(asset()))) as server, client_of(server, tmp_path) as client:
        first, again = (post(client, address(server), key="a") for _ in range(2))
        assert again.json()["id"] == first.json()["id"]
        assert again.headers["Idempotent-Replayed"] == "true"
        other = post(client, address(server, "/other.obj"), key="a")
        assert other.json()["code"] == "idempotency_key_reused"


def test_on_many_machines_the_asset_goes_from_the_address_into_the_bucket(
    s3: S3, database_url: str, tmp_path: Path
) -> None:
    with serving(replying(response(asset()))) as server:
        settings = bucket_settings(s3.new_bucket(), tmp_path, database_url=database_url, **allowing(server))
        with client_with(settings) as client:
            url = post(client, address(server)).headers["Location"]
            client.run(url)
            job = client.http.get(url).json()
            assert job["state"] == "succeeded"
            assert job["input"]["sha256"] in {item.sha256 for item in client.artifacts.listing()}
