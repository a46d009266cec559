import os
import subprocess
import sys
import time
from pathlib import Path

from service.config import Settings
from service.jobs.dead import WORKER_LOST
from service.jobs.models import Queue
from service.jobs.queue import depth
from tests.service.conftest import Client, client_with
from tests.worker.waiting import PATIENCE


def command(folder: Path, *arguments: str, code: int = 0) -> str:
    """What `python -m service jobs` prints."""
    ended = subprocess.run(
        [sys.executable, "-m", "service", "jobs", *arguments],
        env=os.environ | {"MESHMARK_DATA_DIR": os.fspath(folder)},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert ended.returncode == code, ended.stderr
    return ended.stdout if code == 0 else ended.stderr


def die(client: Client) -> str:
    """The id of a job whose worker died too often."""
    job_id = client.submit().rsplit("/", 1)[1]
    assert client.worker.ledger.claim(job_id, 0.001)
    time.sleep(0.01)
    assert client.worker.ledger.recover(1, WORKER_LOST) == ([], [job_id])
    return job_id


def test_a_dead_job_is_listed_and_its_asset_can_be_sent_again(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path)) as client:
        assert command(tmp_path, "dead") == ""
        dead = die(client)
        before = client.http.get(f"/v1/watermarks/{dead}").json()
        row = command(tmp_path, "dead", "--tenant", "default").strip().split("\t")
        assert (row[0], row[1], row[3], row[5]) == (dead, "default", "1 attempts", "asset.obj")
        assert command(tmp_path, "dead", "--tenant", "acme") == ""
        waiting = depth(client.worker.celery, Queue.SMALL)
        again = f"/v1/watermarks/{command(tmp_path, 'retry', dead).strip()}"
        assert depth(client.worker.celery, Queue.SMALL) == waiting + 1
        client.run(again)
        done = client.http.get(again).json()
        assert (done["state"], done["input"], done["parameters"]) == (
            "succeeded",
            before["input"],
            before["parameters"],
        )
        assert client.http.get(f"/v1/watermarks/{dead}").json() == before


def test_what_cannot_be_tried_again_is_said(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path)) as client:
        url = client.submit()
        client.run(url)
        done, dead = url.rsplit("/", 1)[1], die(client)
        assert "no job" in command(tmp_path, "retry", done, code=1)
        assert client.http.delete(f"/v1/watermarks/{dead}").status_code == 204
        assert "gone" in command(tmp_path, "retry", dead, code=1)
        assert command(tmp_path, "dead").split("\t")[4] == "deleted"
