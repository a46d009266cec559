import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.config import Settings
from service.data_folder import keep_private
from tests.service.harness import EMBEDDED_COMMAND, Service
from tests.worker.waiting import PATIENCE, wait_until

OPEN = "import os, sys; os.umask(0); os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"  # for everybody
OTHERS = stat.S_IRWXG | stat.S_IRWXO


@pytest.fixture(autouse=True)
def umask() -> Iterator[None]:
    before = os.umask(0o022)
    yield
    os.umask(before)


def open_to_others(folder: Path) -> list[str]:
    return [os.fspath(path) for path in [folder, *folder.rglob("*")] if path.lstat().st_mode & OTHERS]


def test_whatever_the_umask_no_other_user_reads_a_file_of_the_service_or_its_worker(tmp_path: Path) -> None:
    service = Service(tmp_path)
    with service.running([sys.executable, "-c", OPEN, *EMBEDDED_COMMAND[1:]]):
        first = service.start_job()
        service.wait_for(first, "succeeded")
        hangs = service.start_job("hang")
        wait_until(lambda: service.job(hangs)["stage"] == "placing")
        folder = Path(service.environment["MESHMARK_DATA_DIR"])
        assert {path.name for path in folder.iterdir()} >= {"ledger.sqlite3", "ledger.sqlite3-wal", "artifacts"}
        assert list(folder.glob("scratch/*/input"))
        assert open_to_others(folder) == []


@pytest.mark.parametrize("command", [["service", "keys", "create", "--name", "x"], ["service", "jobs", "dead"]])
def test_nor_one_of_the_commands(command: list[str], tmp_path: Path) -> None:
    variables = {"MESHMARK_DATA_DIR": os.fspath(tmp_path / "data")}
    arguments = [sys.executable, "-c", OPEN, "-m", *command]
    subprocess.run(arguments, env=os.environ | variables, check=True, capture_output=True, timeout=PATIENCE)
    assert (tmp_path / "data" / "ledger.sqlite3").exists()
    assert open_to_others(tmp_path / "data") == []


def test_a_folder_and_a_ledger_from_before_are_shut(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data", database_url=f"sqlite:///{tmp_path / 'elsewhere.sqlite3'}")
    settings.data_dir.mkdir(mode=0o755)
    (tmp_path / "elsewhere.sqlite3").touch(mode=0o644)
    keep_private(settings)
    assert stat.S_IMODE(settings.data_dir.stat().st_mode) == 0o700
    assert stat.S_IMODE((tmp_path / "elsewhere.sqlite3").stat().st_mode) == 0o600


def test_a_volume_of_another_users_will_do_if_not_everybody_may_enter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
    for mode in (0o2770, 0o700):
        tmp_path.chmod(mode)
        keep_private(Settings(data_dir=tmp_path))
        assert stat.S_IMODE(tmp_path.stat().st_mode) == mode
    tmp_path.chmod(0o2777)
    with pytest.raises(SystemExit) as ended:
        keep_private(Settings(data_dir=tmp_path))
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert (told.count("\n"), f"{tmp_path} is open to every user" in told) == (1, True)
    keep_private(Settings(data_dir=tmp_path / "within"))
    assert not (tmp_path / "within").stat().st_mode & OTHERS
