"""Findings of `meshmark doctor` about what the service needs."""

import socket
from pathlib import Path

import pytest

from core.doctor import State
from service.config import Settings
from worker import sandbox
from worker.doctor import findings, queue, shut_in


def test_a_service_without_settings_needs_no_redis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MESHMARK_DATA_DIR", str(tmp_path))
    found = {each.part: each for each in findings()}
    assert [*found] == ["sandbox", "queue", "data folder"]
    assert found["queue"].state is State.OK
    assert "without Redis" in found["queue"].found


def test_a_redis_that_does_not_answer_is_missing_and_its_password_is_not_told() -> None:
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))  # bound, and not listening
        port = nobody.getsockname()[1]
        found = queue(Settings(broker_url=f"redis://:secret@127.0.0.1:{port}/0"))
    assert found.state is State.MISSING
    assert f"127.0.0.1:{port} does not answer" in found.found
    assert "secret" not in str(found)


@pytest.mark.parametrize(("asked", "state"), [("required", State.MISSING), ("auto", State.OPTIONAL)])
def test_a_sandbox_with_a_hole_is_missing_where_it_is_required(
    asked: str, state: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sandbox, "probe", lambda _folder, _private: {"network": True, "files": False})
    found = shut_in(Settings(sandbox=asked))
    assert found.state is state
    assert "files" in found.found


def test_settings_that_cannot_work_are_told_of(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MESHMARK_BROKER_URL", "carrier-pigeon://")
    [found] = findings()
    assert found.state is State.MISSING
    assert "MESHMARK_BROKER_URL" in capsys.readouterr().err
