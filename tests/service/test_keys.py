import os
import subprocess
import sys
from pathlib import Path

import pytest

from service.config import Settings
from tests.service.conftest import client_with
from tests.worker.waiting import PATIENCE


def keys(folder: Path, *arguments: str, code: int = 0) -> str:
    """What the command prints."""
    environment = os.environ | {"MESHMARK_DATA_DIR": os.fspath(folder), "MESHMARK_AUTH": "keys"}
    command = [sys.executable, "-m", "service", "keys", *arguments]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert ended.returncode == code, ended.stderr
    return ended.stdout if code == 0 else ended.stderr


def test_a_key_made_by_the_command_opens_the_service_until_it_is_revoked(tmp_path: Path) -> None:
    text = keys(tmp_path, "create", "--tenant", "acme", "--name", "uploads").strip()
    identity = text.split("_")[1]
    headers = {"Authorization": f"Bearer {text}"}
    with client_with(Settings(data_dir=tmp_path, auth="keys")) as client:
        assert client.http.get("/v1/watermarks/nothing", headers=headers).status_code == 404
        row = keys(tmp_path, "list").strip().split("\t")
        assert row[:5] == [identity, "acme", "active", "jobs:read,jobs:write", "for ever"]
        assert row[5].startswith("used 2")
        keys(tmp_path, "revoke", identity)
        assert client.http.get("/v1/watermarks/nothing", headers=headers).status_code == 401
    assert "\trevoked\t" in keys(tmp_path, "list", "--tenant", "acme")
    assert keys(tmp_path, "list", "--tenant", "beta") == ""
    assert "no key" in keys(tmp_path, "revoke", identity, code=1)


def test_a_key_may_be_for_some_things_and_some_days(tmp_path: Path) -> None:
    keys(tmp_path, "create", "--name", "dashboard", "--scope", "jobs:read", "--days", "30")
    row = keys(tmp_path, "list").strip().split("\t")
    assert row[1:4] == ["default", "active", "jobs:read"]
    assert row[4].startswith("until 2")
    assert row[5:] == ["never used", "dashboard"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["create", "--name", "x", "--tenant", "Big Corp"], "is no tenant"),
        (["create", "--name", "x", "--scope", "all"], "invalid choice"),
        (["create", "--name", "x", "--days", "0"], "--days"),
        (["create", "--name", "x" * 101], "--name"),
        ([], "required"),
    ],
)
def test_what_cannot_be_done_is_told(tmp_path: Path, arguments: list[str], said: str) -> None:
    assert said in keys(tmp_path, *arguments, code=2)
