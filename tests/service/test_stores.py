import os
import subprocess
import sys
import threading
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import text

from service.config import Settings
from service.jobs.ledger import Ledger
from service.jobs.stores import open_store
from service.stores import require_own_store, run_adopt_store
from tests.service.postgres import postgres_server
from tests.service.s3 import S3, Flaky, bucket_settings
from tests.worker.waiting import PATIENCE


@pytest.mark.parametrize("command", [["service", "api"], ["service"], ["worker"]])
def test_nothing_starts_on_a_store_of_another_ledger(command: list[str], tmp_path: Path) -> None:
    require_own_store(Settings(data_dir=tmp_path))
    variables = {"MESHMARK_DATA_DIR": os.fspath(tmp_path), "MESHMARK_DATABASE_URL": f"sqlite:///{tmp_path / 'new'}"}
    ended = subprocess.run(
        [sys.executable, "-m", *command], env=os.environ | variables, capture_output=True, text=True, timeout=PATIENCE
    )
    assert ended.returncode == 2, ended.stderr
    assert "belongs to the database" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_a_store_that_does_not_answer_is_named_at_start(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = Settings(data_dir=tmp_path, store_url="s3://bucket", s3_endpoint="http://127.0.0.1:9", s3_region="none")
    with pytest.raises(SystemExit) as ended:
        require_own_store(settings, timeout=0.0)
    assert ended.value.code == 2
    assert "cannot be reached" in capsys.readouterr().err


NOBODY = "postgresql://meshmark:password-of-the-tests@127.0.0.1:9/ledger"


def test_a_database_that_does_not_answer_is_named_at_start(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        require_own_store(Settings(data_dir=tmp_path, database_url=NOBODY), timeout=0.0)
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.startswith("The database does not answer: ")
    assert told.endswith("Check MESHMARK_DATABASE_URL.\n")
    assert (told.count("\n"), "password" in told) == (1, False)


@pytest.mark.parametrize("command", [["keys", "list"], ["jobs", "dead"], ["adopt-store"]])
def test_commands_say_so_too(command: list[str], tmp_path: Path) -> None:
    refused = ended(["service", *command], NOBODY, tmp_path)
    assert refused.returncode == 2
    assert refused.stderr.startswith("The database does not answer: ")
    assert "Traceback" not in refused.stderr


EVERYTHING = [
    *(["service", *words] for words in (["api"], ["keys", "list"], ["jobs", "dead"], ["adopt-store"])),
    ["worker"],
    ["worker.webhooks"],
]


def ended(command: list[str], url: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    variables = {"MESHMARK_DATA_DIR": os.fspath(folder), "MESHMARK_DATABASE_URL": url}
    return subprocess.run(
        [sys.executable, "-m", *command],
        env=os.environ | variables,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )


@pytest.mark.parametrize("command", EVERYTHING, ids=" ".join)
def test_a_ledger_that_is_no_database_is_told_in_a_sentence(command: list[str], tmp_path: Path) -> None:
    (tmp_path / "none").write_bytes(b"not a database " * 1000)
    url = f"sqlite:///{tmp_path / 'none'}"
    refused = ended(command, url, tmp_path / "data")
    assert refused.returncode == 2, refused.stderr
    assert refused.stderr.splitlines()[-1].startswith(f"The database {url} cannot be the ledger: file is not a ")
    assert "Traceback" not in refused.stderr


def test_a_ledger_of_a_later_version_is_refused_without_its_password(database_url: str, tmp_path: Path) -> None:
    url = database_url.replace("meshmark@", "meshmark:password-of-the-tests@")
    with closing(Ledger(url)) as ledger, ledger.sessions.begin() as session:
        session.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    refused = ended(["service", "keys", "list"], url, tmp_path)
    assert refused.returncode == 2
    assert "schema 9999" in refused.stderr
    assert "password" not in refused.stderr
    assert refused.stderr.count("\n") == 1


def test_a_database_that_is_back_soon_is_waited_for(tmp_path: Path) -> None:
    """By a worker too, which else would start without having looked at anything."""
    with postgres_server() as server:
        settings = Settings(data_dir=tmp_path, database_url=server.new_database())
        server.stop()
        threading.Timer(1, server.start).start()
        require_own_store(settings, timeout=PATIENCE)


def test_the_command_hands_a_store_over_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    require_own_store(Settings(data_dir=tmp_path))
    before = open_store(Settings(data_dir=tmp_path)).owner()
    settings = Settings(data_dir=tmp_path, database_url=f"sqlite:///{tmp_path / 'new'}")
    assert run_adopt_store(settings) == 0
    ledger = Ledger(settings.ledger_url)
    assert capsys.readouterr().out.strip().endswith(f"{ledger.identity} now; before, to {before}.")
    ledger.close()
    require_own_store(settings)


def test_a_store_that_is_back_soon_is_waited_for(s3: S3, tmp_path: Path) -> None:
    with Flaky(s3.url).running() as flaky:
        bucket = s3.new_bucket()
        bucket.endpoint = flaky.url
        flaky.failing.set()
        threading.Timer(1, flaky.failing.clear).start()
        require_own_store(bucket_settings(bucket, tmp_path), timeout=PATIENCE)
        assert flaky.failed > 0
