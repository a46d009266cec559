"""Uploads are looked through in processes of their own: what one of them does is no harm to anything else."""

import contextlib
import hashlib
import json
import sys
import threading
import tracemalloc
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx2
import psutil
import pytest

from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit
from core.parameters import Parameters
from service.config import Settings
from service.intake import Intake
from service.jobs.artifacts import Staged
from service.jobs.tenants import Scope, create_key
from service.template import Template
from tests.core.artwork.fontsmith import SQUARE, make_font
from tests.core.formats.samples import SAMPLES, zipped
from tests.service import gates
from tests.service.conftest import Client, client_with, gate
from tests.service.gates import NO_FACE
from tests.service.harness import Service
from tests.service.routes.test_batch import item, send, upload
from tests.worker.engines import asset
from tests.worker.waiting import PATIENCE, gone, wait_until

MIB = 2**20
COLLADA = b'<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">%b</COLLADA>'
ELEMENTS = zipped({"a.dae": COLLADA % (b"<a/>" * 3 * 10**6)})
ATTRIBUTES = zipped({"a.dae": COLLADA % b"<a %b/>" % b" ".join(b'a%x=""' % number for number in range(10**6))})
API = (
    "import service.app; from service.__main__ import serve; from service.config import Settings\n"
    "from tests.service.gates import obedient; service.app.gate_template = obedient; serve(Settings())"
)


@pytest.fixture(scope="module")
def obedient() -> Iterator[Template]:
    with closing(gates.obedient()) as template:
        yield template


def staged(folder: Path, content: bytes) -> Staged:
    path = folder / "asset"
    path.write_bytes(content)
    return Staged(path, hashlib.sha256(content).hexdigest(), len(content))


def refusal(folder: Path, content: bytes, template: Template, **settings: Any) -> MeshmarkError:
    intake = Intake(Settings(data_dir=folder, **settings), template)
    with pytest.raises(MeshmarkError) as caught:
        intake.check("acme", Parameters(text="HI"), staged(folder, content), None)
    return caught.value


def children(template: Template) -> list[psutil.Process]:
    assert template._process is not None
    return list(psutil.Process(template._process.pid).children())


@pytest.mark.parametrize("name", SAMPLES)
def test_every_format_is_looked_through_without_files_network_and_imports(name: str, tmp_path: Path) -> None:
    intake = Intake(Settings(data_dir=tmp_path, sandbox="required"), gate())
    intake.check("acme", Parameters(text="HI"), staged(tmp_path, SAMPLES[name]), None)
    for length in (10, 40):
        damaged = SAMPLES[name][:length]
        with pytest.raises(MeshmarkError) as expected:
            admit(damaged)
        assert str(refusal(tmp_path, damaged, gate(), sandbox="required")) == str(expected.value)


def test_what_looks_through_an_upload_reaches_nothing_else(obedient: Template, tmp_path: Path) -> None:
    assert json.loads(refusal(tmp_path, gates.PEEK + NO_FACE, obedient).message) == []
    assert not (tmp_path / "written").exists()


@pytest.mark.parametrize("hostile", [ELEMENTS, ATTRIBUTES, b"v 0 0 0\n" + b"\n" * 8 * MIB])
def test_the_service_itself_holds_nothing_of_a_hostile_upload(hostile: bytes, tmp_path: Path) -> None:
    path = staged(tmp_path, hostile)
    intake = Intake(Settings(data_dir=tmp_path), gate())
    tracemalloc.start()
    try:
        with pytest.raises(MeshmarkError) as caught:
            intake.check("acme", Parameters(text="HI"), path, None)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert caught.value.code in (ErrorCode.BUDGET_EXCEEDED, ErrorCode.NO_FACES)
    assert peak < MIB


def test_an_upload_that_crashes_the_gate_is_refused_and_the_next_one_is_not(obedient: Template, tmp_path: Path) -> None:
    crash = refusal(tmp_path, gates.CRASH + NO_FACE, obedient)
    assert crash.code is ErrorCode.ENGINE_CRASHED
    assert "SIGSEGV" in crash.message
    Intake(Settings(data_dir=tmp_path), obedient).check("acme", Parameters(text="HI"), staged(tmp_path, asset()), None)
    assert children(obedient) == []


def test_an_upload_whose_process_ends_before_it_reads_anything_is_refused(tmp_path: Path) -> None:
    ends = (
        "import os, socket; from service.template import serve as s; s(socket.socket(fileno=0), lambda *_: os._exit(3))"
    )
    with closing(Template([sys.executable, "-c", ends], threads=1, name="gate")) as template:
        assert refusal(tmp_path, NO_FACE, template).code is ErrorCode.ENGINE_CRASHED


def test_a_template_that_dies_takes_its_uploads_with_it_and_is_replaced(obedient: Template, tmp_path: Path) -> None:
    errors = list[MeshmarkError]()
    hang = threading.Thread(
        target=lambda: errors.append(refusal(tmp_path, gates.HANG + NO_FACE, obedient, intake_time_limit=600))
    )
    obedient.start()
    assert obedient._process is not None
    before = obedient._process.pid
    hang.start()
    wait_until(lambda: children(obedient))
    [child] = children(obedient)
    psutil.Process(before).kill()
    hang.join(PATIENCE)
    assert [error.code for error in errors] == [ErrorCode.ENGINE_CRASHED]
    wait_until(lambda: gone(child))
    (tmp_path / "then").mkdir()
    assert refusal(tmp_path / "then", NO_FACE, obedient).code is ErrorCode.NO_FACES
    assert obedient._process.pid != before


def test_an_upload_that_takes_too_long_is_refused_and_its_process_killed(obedient: Template, tmp_path: Path) -> None:
    late = refusal(tmp_path, gates.HANG + NO_FACE, obedient, intake_time_limit=0.2)
    assert late.code is ErrorCode.BUDGET_EXCEEDED
    assert "0.2 seconds" in late.message
    assert children(obedient) == []


def test_an_upload_that_takes_too_much_memory_is_refused_for_it(obedient: Template, tmp_path: Path) -> None:
    large = refusal(tmp_path, gates.FILL + NO_FACE, obedient)
    assert large.code is ErrorCode.BUDGET_EXCEEDED
    assert "MiB of memory" in large.message


def test_a_font_is_looked_at_in_such_a_process_too(tmp_path: Path) -> None:
    intake = Intake(Settings(data_dir=tmp_path, sandbox="required"), gate())
    with pytest.raises(MeshmarkError) as caught:
        intake.check("acme", Parameters(text="HI"), None, staged(tmp_path, b"\0\1\0\0" + bytes(100)))
    assert caught.value.code is ErrorCode.INVALID_FONT
    with pytest.raises(MeshmarkError) as caught:
        intake.check("acme", Parameters(text="\ue000"), None, None)
    assert caught.value.code is ErrorCode.MISSING_GLYPHS


def test_what_a_font_lacks_is_looked_for_in_the_installed_ones_there_too(tmp_path: Path) -> None:
    intake = Intake(Settings(data_dir=tmp_path, sandbox="required"), gate())
    font = staged(tmp_path, make_font({"A": [SQUARE], "I": [SQUARE]}))
    intake.check("acme", Parameters(text="AI\u751f\u6210"), None, font)
    with pytest.raises(MeshmarkError, match=r"U\+E000") as caught:
        intake.check("acme", Parameters(text="AI\ue000"), None, font)
    assert caught.value.code is ErrorCode.MISSING_GLYPHS


class Tenant:
    """A client with the key of a tenant."""

    def __init__(self, client: Client, name: str) -> None:
        key = create_key(client.worker.ledger.sessions, name, "a key", Scope)
        self.http, self.headers = client.http, {"Authorization": f"Bearer {key.text}"}

    def look(self) -> int:
        return int(self.http.get("/v1/watermarks", headers=self.headers).status_code)

    def send(self, content: bytes) -> httpx2.Response:
        parts = {"file": ("asset.obj", content)}
        return self.http.post("/v1/watermarks", headers=self.headers, files=parts, data={"params": '{"text": "HI"}'})


def test_whatever_a_tenant_sends_the_others_are_answered_meanwhile(obedient: Template, tmp_path: Path) -> None:
    started, go = tmp_path / "started", tmp_path / "go"
    settings = Settings(data_dir=tmp_path, auth="keys", intake_time_limit=PATIENCE, max_uploads_at_once=0)
    with client_with(settings, obedient) as client:
        hostile, other = Tenant(client, "hostile"), Tenant(client, "other")
        answers = list[httpx2.Response]()
        # more than there are threads, for uploads and for the rest
        threads = [
            threading.Thread(target=lambda: answers.append(hostile.send(gates.noted(started, go)))) for _ in range(80)
        ]
        for thread in threads:
            thread.start()
        try:
            wait_until(started.exists)
            assert other.look() == 200
            assert other.send(asset()).status_code == 202
            assert hostile.look() == 200
            assert other.send(NO_FACE).json()["code"] == "no_faces"
            assert answers == []
            assert len(list(started.iterdir())) == 1, "of two processes one is for others"
        finally:
            go.touch()
            for thread in threads:
                thread.join(PATIENCE)
    assert [answer.json()["code"] for answer in answers] == ["no_faces"] * 80


def test_an_upload_that_a_batch_names_often_is_looked_through_once(obedient: Template, tmp_path: Path) -> None:
    started, go = tmp_path / "started", tmp_path / "go"
    go.touch()
    with client_with(Settings(data_dir=tmp_path), obedient) as client:
        bad, good = upload(client, gates.noted(started, go)), upload(client)
        results = send(client, *(item(each, text) for text in ("ONE", "TWO", "THREE") for each in (bad, good)))
        codes = [{"text": text, "qr": "https://a.example"} for text in ("ONE", "TWO")]
        results += send(client, *({"upload_id": each, "parameters": code} for code in codes for each in (bad, good)))
    assert [result["status"] for result in results] == [422, 202] * 5
    assert {result["problem"]["code"] for result in results[::2]} == {"no_faces"}
    assert len(list(started.iterdir())) == 2, "once for each batch"


@pytest.mark.parametrize("how", ["terminate", "kill"])
def test_no_process_outlives_the_service(how: str, tmp_path: Path) -> None:
    service = Service(tmp_path, intake_time_limit="600")
    with service.running([sys.executable, "-c", API]) as [api]:
        this = psutil.Process(api.pid)

        def hang() -> None:
            with contextlib.suppress(httpx2.TransportError):
                assert service.submit(gates.HANG + NO_FACE).status_code >= 500

        threads = [threading.Thread(target=hang) for _ in range(3)]
        for thread in threads:
            thread.start()
        wait_until(lambda: len(this.children(recursive=True)) == 2)  # the template, and the process of one upload
        family = this.children(recursive=True)
        getattr(this, how)()
        api.wait(PATIENCE)
        wait_until(lambda: all(map(gone, family)))
        for thread in threads:
            thread.join(PATIENCE)
