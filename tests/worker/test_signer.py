"""Results get their Content Credentials from a signer before they have succeeded, whatever happens to it."""

import io
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from sqlalchemy import select, update

from core.credentials.facts import CredentialState
from core.credentials.read import read_credentials
from core.credentials.sign import Signer
from service.config import Settings
from service.credentials import CHAIN, KEY, require_chain
from service.jobs.clock import now
from service.jobs.models import Job
from service.jobs.signing import take_due
from service.routes.report_example import REPORT
from tests.service.conftest import Client, client_with
from tests.service.harness import Service, free_port, running
from tests.service.s3 import S3, bucket_settings
from tests.worker.engines import asset
from tests.worker.waiting import wait_until
from worker.signer import SignerProcess
from worker.sweeper import sweep
from worker.tasks import private_folders

GLB = "model/gltf-binary"
WORKER = [sys.executable, "-m", "worker"]
SIGNER = [sys.executable, "-m", "worker.signer"]
EVERYTHING = [sys.executable, "-m", "service"]


def picture(kind: str = "PNG") -> str:
    file = io.BytesIO()
    Image.new("RGB", (16, 8), (9, 90, 200)).save(file, kind)
    return file.getvalue().hex()


def order(**changes: Any) -> bytes:
    """An asset whose engine leaves a report and a picture that can be signed."""
    return asset(**{"report": deepcopy(REPORT), "picture": picture(), "animation": picture("WEBP"), **changes})


def self_signed(folder: Path) -> dict[str, Any]:
    """Settings of a chain made by the command for it."""
    made = subprocess.run(
        [sys.executable, "-m", "service", "credentials", "self-signed", folder], capture_output=True, text=True
    )
    assert made.returncode == 0, made.stderr
    assert "proves nothing" in made.stderr
    return {"c2pa_key": folder / KEY, "c2pa_chain": folder / CHAIN}


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return self_signed(tmp_path_factory.mktemp("chain"))


class Signed:
    """A client of a service whose results are signed, and a signer that does so when it is told to."""

    def __init__(self, client: Client, settings: Settings) -> None:
        self.client, self.http = client, client.http
        self.signer = SignerProcess(settings, Signer(require_chain(settings), settings.c2pa_timestamp_url or None))

    def finish(self, content: bytes | None = None, params: str = '{"text": "HI"}') -> str:
        """The URL of a job whose results wait for the signer."""
        url = self.client.submit(order() if content is None else content, params)
        self.client.run(url)
        return url

    def job(self, url: str) -> Any:
        return self.http.get(url).json()

    def make_due(self) -> None:
        with self.client.worker.ledger.sessions.begin() as session:
            session.execute(update(Job).where(Job.sign_at.is_not(None)).values(sign_at=now()))


@pytest.fixture
def signed(
    request: pytest.FixtureRequest, database_url: str, chain: dict[str, Any], tmp_path: Path
) -> Iterator[Signed]:
    """Beside SQLite with artifacts in a folder, beside PostgreSQL in a bucket."""
    more: dict[str, Any] = {"database_url": database_url, **chain}
    if database_url.startswith("sqlite"):
        settings = Settings(data_dir=tmp_path, **more)
    else:
        s3: S3 = request.getfixturevalue("s3")
        settings = bucket_settings(s3.new_bucket(), tmp_path, **more)
    with client_with(settings) as client:
        signed = Signed(client, settings)
        yield signed
        signed.signer.signer.close()
        signed.signer.ledger.close()


def test_a_result_has_succeeded_once_it_is_signed(signed: Signed) -> None:
    url = signed.finish()
    waiting = signed.job(url)
    assert (waiting["state"], waiting["stage"]) == ("running", "signing")
    assert waiting["links"]["model"] == f"{url}/model", "who does not need credentials need not wait"
    missing = signed.http.get(f"{url}/credentials")
    assert (missing.status_code, missing.json()["code"]) == (409, "not_ready")
    assert "Link" not in signed.http.get(f"{url}/model").headers
    signed.signer.sign_due()
    done = signed.job(url)
    assert (done["state"], done["stage"], done["links"]["credentials"]) == ("succeeded", None, f"{url}/credentials")


def test_the_sidecar_fits_the_model_and_each_picture_has_its_own(signed: Signed, chain: dict[str, Any]) -> None:
    url = signed.finish(params='{"text": "HI", "turntable": true}')
    signed.signer.sign_due()
    model, sidecar, preview = (signed.http.get(f"{url}/{part}") for part in ("model", "credentials", "preview"))
    assert model.headers["Link"] == f'<{url}/credentials>; rel="c2pa-manifest"'
    assert signed.http.head(f"{url}/model").headers["Link"] == model.headers["Link"]
    assert sidecar.headers["Content-Type"] == "application/c2pa"
    assert sidecar.headers["ETag"] != model.headers["ETag"]
    assert sidecar.headers["Content-Disposition"] == 'attachment; filename="asset.watermarked.c2pa"'
    anchors = (chain["c2pa_chain"]).read_text().split("-----BEGIN", 2)[2]
    found = read_credentials(model.content, GLB, sidecar.content, "-----BEGIN" + anchors)
    assert (found.state, found.marks, found.title) == (CredentialState.TRUSTED, ("SAMPLE",), "asset.watermarked.glb")
    assert read_credentials(preview.content, "image/png").state == CredentialState.VALID
    for part in ("turntable", "poster"):
        assert read_credentials(signed.http.get(f"{url}/{part}").content, "image/webp").state == CredentialState.VALID
    with Image.open(io.BytesIO(preview.content)) as shown:
        assert shown.convert("RGB").getpixel((0, 0)) == (9, 90, 200)


def test_the_preview_model_has_credentials_of_its_own_with_the_marks_that_it_carries(signed: Signed) -> None:
    light = {"sha256": "ab" * 32, "watermarks": []}
    url = signed.finish(
        order(report={**deepcopy(REPORT), "preview_model": light}), '{"text": "HI", "preview_model": {}}'
    )
    signed.signer.sign_due()
    model, beside = (signed.http.get(f"{url}/{part}") for part in ("preview_model", "preview_manifest"))
    assert model.headers["Link"] == f'<{url}/preview_manifest>; rel="c2pa-manifest"'
    assert beside.headers["Content-Disposition"] == 'attachment; filename="asset.watermarked.preview.c2pa"'
    found = read_credentials(model.content, GLB, beside.content)
    assert (found.state, found.marks, found.title) == (CredentialState.VALID, (), "asset.watermarked.preview.glb")
    of_the_model = signed.http.get(f"{url}/credentials").content
    assert read_credentials(model.content, GLB, of_the_model).state == CredentialState.TAMPERED


def test_no_worker_does_the_work_again_because_no_signer_runs(signed: Signed) -> None:
    url = signed.finish()
    with signed.client.worker.ledger.sessions() as session:
        assert session.scalars(select(Job.lease_expires_at)).all() == [None], "whenever it is looked for"
    sweep(signed.client.worker)
    assert (signed.job(url)["state"], signed.job(url)["attempts"]) == ("running", 1)


def test_a_signer_that_died_leaves_its_job_to_another(signed: Signed) -> None:
    url = signed.finish()
    sessions = signed.client.worker.ledger.sessions
    taken = take_due(sessions)
    assert taken is not None  # and then it dies
    assert take_due(sessions) is None, "nobody else is at it meanwhile"
    signed.signer.sign_due()
    assert signed.job(url)["state"] == "running"
    signed.make_due()
    signed.signer.sign_due()
    assert signed.job(url)["state"] == "succeeded"


def test_of_two_signers_at_the_same_job_one_ends_it(signed: Signed) -> None:
    urls = [signed.finish(order(number=number)) for number in range(6)]
    threads = [threading.Thread(target=signed.signer.sign_due), threading.Thread(target=signed.signer.sign_due)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for url in urls:
        assert signed.job(url)["state"] == "succeeded"
        model, sidecar = signed.http.get(f"{url}/model"), signed.http.get(f"{url}/credentials")
        assert read_credentials(model.content, GLB, sidecar.content).state == CredentialState.VALID


def test_a_job_that_is_deleted_while_it_waits_is_signed_no_more(signed: Signed) -> None:
    url = signed.finish()
    assert signed.http.delete(url).status_code == 204
    signed.signer.sign_due()
    assert signed.job(url)["state"] == "canceled"
    assert signed.job(url)["links"]["credentials"] is None


@pytest.mark.parametrize("broken", [{"report": {"text": "none"}}, {"report": [1]}, {"picture": "00"}])
def test_results_that_cannot_be_signed_fail_and_are_not_tried_for_ever(signed: Signed, broken: dict[str, Any]) -> None:
    url = signed.finish(order(**broken))
    signed.signer.sign_due()
    job = signed.job(url)
    assert (job["state"], job["error"]["code"]) == ("failed", "internal_error")
    assert "cannot be signed" in job["error"]["detail"]


def test_a_server_of_time_stamps_that_does_not_answer_delays_the_result(chain: dict[str, Any], tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, c2pa_timestamp_url=f"http://127.0.0.1:{free_port()}", **chain)
    with client_with(settings) as client:
        signed = Signed(client, settings)
        url = signed.finish()
        signed.signer.sign_due()
        assert (signed.job(url)["state"], signed.job(url)["links"]["credentials"]) == ("running", None)
        signed.make_due()
        signed.signer.signer = Signer(require_chain(settings))
        signed.signer.sign_due()
        assert signed.job(url)["state"] == "succeeded"


def test_a_result_without_credentials_does_not_serve_who_is_to_have_them(chain: dict[str, Any], tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, cache=True)) as client:
        client.run(client.submit(order()))
        assert client.http.get(client.submit(order())).json()["cached"]
    settings = Settings(data_dir=tmp_path, cache=True, **chain)
    with client_with(settings) as client:
        signed = Signed(client, settings)
        url = client.submit(order())
        assert not signed.job(url)["cached"]
        client.run(url)
        signed.signer.sign_due()
        again = signed.job(client.submit(order()))
        assert (again["cached"], again["state"]) == (True, "succeeded")
        assert again["links"]["credentials"] is not None


def test_the_key_is_hidden_from_the_engine(chain: dict[str, Any], tmp_path: Path) -> None:
    assert chain["c2pa_key"].resolve() in private_folders(Settings(data_dir=tmp_path, **chain))
    assert chain["c2pa_key"].stat().st_mode & 0o077 == 0


def test_the_command_overwrites_no_key(chain: dict[str, Any]) -> None:
    before = chain["c2pa_key"].read_bytes()
    command = [sys.executable, "-m", "service", "credentials", "self-signed", str(chain["c2pa_key"].parent)]
    again = subprocess.run(command, capture_output=True, text=True)
    assert (again.returncode, "cannot be written" in again.stderr) == (2, True)
    assert chain["c2pa_key"].read_bytes() == before


@pytest.mark.parametrize("command", [SIGNER, EVERYTHING])
def test_a_key_that_does_not_fit_its_chain_is_refused_at_start(
    command: list[str], chain: dict[str, Any], tmp_path: Path
) -> None:
    other = self_signed(tmp_path / "other")
    settings = {"C2PA_KEY": other["c2pa_key"], "C2PA_CHAIN": chain["c2pa_chain"], "DATA_DIR": tmp_path / "data"}
    environment = {f"MESHMARK_{name}": os.fspath(value) for name, value in settings.items()}
    ended = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True)
    assert ended.returncode == 2
    assert "The key is not that of the chain's first certificate" in ended.stderr
    assert "PRIVATE KEY" not in ended.stderr + ended.stdout


@pytest.mark.parametrize("command", [WORKER, EVERYTHING])
def test_trusted_certificates_that_are_none_are_refused_at_start(command: list[str], tmp_path: Path) -> None:
    roots = tmp_path / "roots.pem"
    roots.write_text("no certificate")
    settings = {"C2PA_TRUST": roots, "DATA_DIR": tmp_path / "data"}
    environment = {f"MESHMARK_{name}": os.fspath(value) for name, value in settings.items()}
    ended = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True)
    assert (ended.returncode, f"{roots} holds no certificates in PEM" in ended.stderr) == (2, True)


@pytest.mark.parametrize("missing", ["C2PA_KEY", "C2PA_CHAIN"])
def test_a_signer_without_its_files_says_what_it_needs(missing: str, chain: dict[str, Any], tmp_path: Path) -> None:
    settings = {"C2PA_KEY": chain["c2pa_key"], "C2PA_CHAIN": chain["c2pa_chain"], "DATA_DIR": tmp_path / "data"}
    environment = {f"MESHMARK_{name}": os.fspath(value) for name, value in settings.items() if name != missing}
    ended = subprocess.run(SIGNER, env=os.environ | environment, capture_output=True, text=True)
    assert (ended.returncode, "MESHMARK_C2PA_CHAIN" in ended.stderr) == (2, True)


def test_the_processes_of_a_service_sign_a_real_result(chain: dict[str, Any], tmp_path: Path) -> None:
    service = Service(tmp_path, **{name: os.fspath(path) for name, path in chain.items()})
    cube = b"".join(b"v %d %d %d\n" % (x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1))
    cube += b"f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
    with service.running(EVERYTHING):
        url = service.submit(cube, '{"text": "SAMPLE", "count": 1, "evaluate": "none"}').headers["Location"]
        job = service.wait_for(url, "succeeded")
        model, sidecar, report = (service.client.get(job["links"][part]) for part in ("model", "credentials", "report"))
    found = read_credentials(model.content, GLB, sidecar.content)
    assert (found.state, found.marks, found.title) == (CredentialState.VALID, ("SAMPLE",), "asset.watermarked.glb")
    assert json.loads(report.content)["model"]["sha256"] in model.headers["ETag"]


def test_a_signer_ends_when_it_is_told_to(chain: dict[str, Any], tmp_path: Path) -> None:
    port = free_port()
    settings = {**chain, "data_dir": tmp_path, "signer_metrics_port": port}
    environment = {f"MESHMARK_{name.upper()}": str(value) for name, value in settings.items()}

    def serves() -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    with running(SIGNER, environment, quiet=True) as process:
        wait_until(serves)
    assert process.returncode == 0
