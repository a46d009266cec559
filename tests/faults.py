"""`python -m tests.faults`: everything fails in turn while jobs run; what came of them is printed as a table.

Real processes throughout: PostgreSQL, Redis, an S3 server over HTTP, the API and three workers, each with a data folder
of its own as on a machine of its own. Only the engine is that of the tests: it takes no time.
"""

import contextlib
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import httpx2
import psutil
from sqlalchemy import func, select

from service.jobs import contents
from service.jobs.ledger import Ledger
from service.jobs.models import Artifact, Job
from service.jobs.ownership import claim
from service.jobs.stores import open_store
from tests.service.harness import API_COMMAND, Service, free_port, redis_server
from tests.service.postgres import Postgres, postgres_server
from tests.service.s3 import Bucket, Flaky, bucket_settings, s3_server
from tests.worker.engines import asset
from tests.worker.waiting import wait_until

WORKER_COMMAND = [sys.executable, "-m", "tests.worker.apps"]
ENDED = {"succeeded", "failed", "canceled", "expired"}
SMALL_DISK = 2**20  # bytes
FOR_THE_THIRD = 4096  # bytes of an asset from which on only the third worker takes it
DISK_FULL = "the disk cannot be written to"  # as workers log it
OUTAGE = 2.0  # seconds


@dataclass
class Process:
    """One that may be killed and started again; its log goes on in the same file."""

    command: list[str]
    environment: dict[str, str]
    log: Path

    def start(self) -> None:
        with self.log.open("ab") as log:
            self.popen = subprocess.Popen(
                self.command, env=os.environ | self.environment, stdout=log, stderr=log, start_new_session=True
            )

    def end(self, number: int) -> None:
        self.popen.send_signal(number)
        self.popen.wait(30)

    def restart(self, number: int = signal.SIGKILL) -> None:
        self.end(number)
        self.start()


@dataclass
class Site:
    """All that runs, and what it was asked for."""

    service: Service
    database: Postgres
    flaky: Flaky
    bucket: Bucket
    api: Process
    workers: list[Process]
    broker: ExitStack
    start_broker: Callable[[], None]
    numbers: Iterator[int]  # of the jobs to come
    jobs: dict[str, str] = field(default_factory=dict)  # the text of each accepted job by its address
    sent_again: int = 0

    @property
    def small_disk(self) -> Path | None:
        """The third worker's data folder, if it is a small disk of its own: that takes the right to mount one."""
        folder = Path(self.workers[2].environment["MESHMARK_DATA_DIR"])
        return folder if folder.is_mount() else None

    def submit(self, number: int, size: int = 0) -> str:
        """Send an asset of at least so many bytes until it is accepted, as a client does who wants it done once.

        Returns:
            The job's address.
        """
        text = f"J{number}"
        parts = {"file": ("asset.obj", asset(number=number, padding="." * size))}
        deadline = time.monotonic() + 40
        while time.monotonic() < deadline:
            with contextlib.suppress(httpx2.TransportError):
                response = self.service.client.post(
                    "/v1/watermarks",
                    files=parts,
                    data={"params": json.dumps({"text": text})},
                    headers={"Idempotency-Key": text},
                )
                if response.status_code == 202:
                    self.jobs[response.headers["Location"]] = text
                    return response.headers["Location"]
                assert response.status_code in (409, 503), response.text
            self.sent_again += 1
            if self.api.popen.poll() is not None:  # as the restart policy in compose.yaml does
                self.api.start()
            time.sleep(0.2)
        raise AssertionError(f"{text} was not accepted in time; the API's log ends: {self.api.log.read_text()[-4000:]}")


def kill_worker(site: Site) -> None:
    wait_until(lambda: children(site.workers[0]))
    site.workers[0].restart()


def kill_child(site: Site) -> None:
    wait_until(lambda: any(map(children, site.workers)))
    for child in (child for worker in site.workers for child in children(worker)):
        with contextlib.suppress(psutil.NoSuchProcess):
            child.kill()
        return


def kill_template(site: Site) -> None:
    """Its engines die with it; the next job starts another."""
    wait_until(lambda: any(map(children, site.workers)))
    for template in next(templates(worker) for worker in site.workers if children(worker)):
        template.kill()


def kill_api(site: Site) -> None:
    site.api.end(signal.SIGKILL)


def restart_worker(site: Site) -> None:
    site.workers[1].restart(signal.SIGTERM)


def empty_redis(site: Site) -> None:
    site.broker.close()
    time.sleep(OUTAGE / 2)
    site.start_broker()


def restart_postgres(site: Site) -> None:
    site.database.stop()
    time.sleep(OUTAGE / 2)
    site.database.start()


def break_store(site: Site) -> None:
    site.flaky.failing.set()
    time.sleep(OUTAGE)
    site.flaky.failing.clear()


def fill_disk(site: Site) -> None:
    """Of the third worker, while it has a job that no other one takes."""
    folder, log = site.small_disk, site.workers[2].log
    if folder is None:
        print("no disk could be filled: that takes the right to mount one", file=sys.stderr)
        return
    met = log.read_text().count(DISK_FULL)
    ballast = folder / "ballast"

    def is_met() -> bool:
        return log.read_text().count(DISK_FULL) > met

    with ballast.open("wb", buffering=0) as file:
        while not is_met():  # jobs that were under way make room when they are done, in which another one may do
            with contextlib.suppress(OSError):
                while True:
                    file.write(bytes(4096))
            url = site.submit(next(site.numbers), FOR_THE_THIRD)
            wait_until(lambda url=url: is_met() or site.service.job(url)["state"] in ENDED)  # type: ignore[misc]
    ballast.unlink()


FAULTS: list[Callable[[Site], None]] = [
    kill_worker,
    empty_redis,
    kill_child,
    break_store,
    kill_template,
    kill_api,
    restart_postgres,
    fill_disk,
    restart_worker,
]


def templates(worker: Process) -> list[psutil.Process]:
    """What a worker's engines are forked from: one process."""
    with contextlib.suppress(psutil.NoSuchProcess):
        return [child for child in psutil.Process(worker.popen.pid).children() if "worker.template" in child.cmdline()]
    return []


def children(worker: Process) -> list[psutil.Process]:
    """The engine's processes under a worker."""
    with contextlib.suppress(psutil.NoSuchProcess):
        return [child for template in templates(worker) for child in template.children()]
    return []


@contextmanager
def small_disk(folder: Path) -> Iterator[None]:
    """A file system of its own on a folder, where we may make one."""
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={SMALL_DISK}", "tmpfs", folder], capture_output=True, check=False
    )
    try:
        yield
    finally:
        if mounted.returncode == 0:
            subprocess.run(["umount", "--lazy", folder], check=True)


@contextmanager
def running_site(folder: Path, jobs: int) -> Iterator[Site]:
    """All servers, the API and three workers, the last one on a small disk."""
    with ExitStack() as stack:
        database, s3, port = stack.enter_context(postgres_server()), stack.enter_context(s3_server()), free_port()
        flaky = stack.enter_context(Flaky(s3.url).running())
        bucket = s3.new_bucket()
        bucket.endpoint = flaky.url
        service = Service(
            folder,
            broker_url=f"redis://127.0.0.1:{port}/0",
            database_url=database.new_database(),
            lease_seconds="3",
            max_attempts="5",
            worker_concurrency="2",
            shutdown_seconds="1",
            gpu_asset_bytes=str(FOR_THE_THIRD),
            **bucket.settings,
        )
        homes = [folder / f"worker {number}" for number in (1, 2, 3)]
        stack.enter_context(small_disk(homes[2]))
        api = Process(API_COMMAND, service.environment, folder / "api.log")
        workers = [
            Process(
                [*WORKER_COMMAND, "--queues", queues],
                service.environment | {"MESHMARK_DATA_DIR": os.fspath(home)},
                home.with_suffix(".log"),
            )
            for home, queues in zip(homes, ("small", "small", "small,gpu"), strict=True)
        ]
        broker = stack.enter_context(ExitStack())

        def start_broker() -> None:
            broker.enter_context(redis_server(folder, port))

        start_broker()
        for process in (api, *workers):
            process.start()
            stack.callback(process.end, signal.SIGKILL)
        service.client = stack.enter_context(httpx2.Client(base_url=service.url, timeout=20))
        wait_until(service.is_up)
        yield Site(service, database, flaky, bucket, api, workers, broker, start_broker, iter(range(jobs)))


def run(folder: Path, jobs: int = 50) -> dict[str, int]:
    """Let everything fail in turn while so many jobs come; returns the counts, once what must hold was checked."""
    with running_site(folder, jobs) as site:
        share = jobs // (len(FAULTS) + 1)
        with ThreadPoolExecutor(1) as pool:
            for fault in FAULTS:
                failing = pool.submit(fault, site)
                for number in islice(site.numbers, share):
                    site.submit(number)
                failing.result()
        for number in site.numbers:
            site.submit(number)
        ended = {url: ended_job(site, url) for url in site.jobs}
        assert len(ended) == jobs
        return check_jobs(site, ended) | check_store(site, folder) | check_workers(site, ended)


def ended_job(site: Site, url: str) -> dict[str, Any]:
    """The job once it has ended."""
    deadline = time.monotonic() + 90
    while time.monotonic() < deadline:
        with contextlib.suppress(httpx2.TransportError):
            response = site.service.client.get(url)
            if response.status_code == 200 and response.json()["state"] in ENDED:
                return dict(response.json())
        time.sleep(0.2)
    raise AssertionError(f"{url} did not end in time")


def check_jobs(site: Site, ended: dict[str, dict[str, Any]]) -> dict[str, int]:
    """Each job has succeeded, with results that are its own and whole, but for those whose engines were killed."""
    failed = [job["error"]["code"] for job in ended.values() if job["state"] != "succeeded"]
    assert set(failed) <= {"engine_crashed"}, f"{failed}; the workers' logs: {complaints(site)}"
    assert len(failed) <= 3, "one by itself, two with their template"
    for url, job in ended.items():
        if job["state"] == "succeeded":
            model, report = site.service.client.get(f"{url}/model"), site.service.client.get(f"{url}/report")
            assert model.content == b"glTF of " + site.jobs[url].encode()
            assert model.headers["ETag"].strip('"') == hashlib.sha256(model.content).hexdigest()
            assert report.json()["text"] == site.jobs[url]
    return {
        "requests that were sent again": site.sent_again,
        "jobs accepted": len(ended),
        "jobs that succeeded": len(ended) - len(failed),
        "jobs that failed, for their engine was killed": len(failed),
        "jobs that were started more than once": sum(job["attempts"] > 1 for job in ended.values()),
    }


def complaints(site: Site) -> str:
    """What the workers logged with a traceback, or their engines wrote to stderr."""
    lines = (line for worker in site.workers for line in worker.log.read_text().splitlines())
    return "\n".join(line for line in lines if "Traceback" in line or "worker failed" in line)


def check_store(site: Site, folder: Path) -> dict[str, int]:
    """Ledger and store agree, once what killed processes left was swept."""
    settings = bucket_settings(site.bucket, folder / "check")
    ledger, store = Ledger(site.service.environment["MESHMARK_DATABASE_URL"]), open_store(settings)
    try:
        claim(ledger, store)
        left = contents.discard_orphans(ledger, store, grace=0)
        stored = {item.sha256 for item in store.listing()}
        with ledger.sessions() as session:
            referenced = set(session.scalars(select(Artifact.sha256)))
            jobs = session.scalar(select(func.count()).select_from(Job))
        assert stored == referenced
        assert jobs == len(site.jobs)
        assert ledger.running() == set()
    finally:
        ledger.close()
    return {"files in the store, all of them some job's": len(stored), "files of none, which were swept": len(left)}


def check_workers(site: Site, ended: dict[str, dict[str, Any]]) -> dict[str, int]:
    """No job was ended twice, and no worker left a file."""
    for worker in site.workers:
        worker.end(signal.SIGTERM)
        assert list(Path(worker.environment["MESHMARK_DATA_DIR"], "scratch").iterdir()) == []
    ends: Counter[str] = Counter()
    put_back = full = 0
    for worker_log, line in (
        (worker.log, line) for worker in site.workers for line in worker.log.read_text().splitlines()
    ):
        with contextlib.suppress(json.JSONDecodeError):
            entry = json.loads(line)
            if entry["event"] in ("job succeeded", "job failed"):
                ends[entry["job"]] += 1
            assert not entry["event"].startswith("messages wait, there is a free place"), worker_log
            full += entry["event"] == DISK_FULL
            put_back += entry["event"].startswith(("job put back", "job given back", "job announced again"))
    assert set(ends.values()) <= {1}, ends
    assert full or not site.small_disk
    assert {url.rsplit("/", 1)[1] for url in ended} >= set(ends)
    return {
        "jobs that a worker ended twice": sum(count > 1 for count in ends.values()),
        "times that jobs were put back or announced again": put_back,
        "times that a disk was full": full,
    }


def main() -> None:
    with tempfile.TemporaryDirectory(prefix="meshmark-faults-") as folder:
        began = time.monotonic()
        counts = run(Path(folder))
        counts["seconds"] = round(time.monotonic() - began)
    for name, count in counts.items():
        print(f"{name:60} {count:>6}")


if __name__ == "__main__":
    main()
