"""`python -m tests.load`: jobs come at a rate of their own, whatever the answers take; prints what that cost, and whom.

Real processes throughout: PostgreSQL that writes to disk, Redis, a store that speaks S3 (SeaweedFS), an API and workers
of one job each, with the default settings, but that the one client here stands for many: no limit to its uploads at
once, which a slow machine would reach. `--engine real` is Meshmark's own, on a box of 12 faces or on `--asset`;
`--engine fast` is that of the tests, which takes no time, so that the service itself is the load.

After the jobs, large assets are sent to the store by presigned links, all at once, and then named as jobs; and the
store hangs while more requests that need it come than an API has threads.

The exit status is 1 where a request was refused, a job failed or was lost, ran twice or left a file out, where the
memory of a process grows, or where a store that hangs keeps the API from answering.
"""

import argparse
import asyncio
import json
import os
import random
import signal
import statistics
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from datetime import datetime
from itertools import accumulate
from pathlib import Path
from typing import Any

import httpx2
import psutil
from prometheus_client.parser import text_string_to_metric_families

from tests.faults import WORKER_COMMAND, Process
from tests.service.harness import API_COMMAND, Service, free_port, redis_server
from tests.service.postgres import postgres_server
from tests.service.s3 import S3, s3_server
from tests.worker.engines import asset
from tests.worker.waiting import wait_until

BOX = (
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
    "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"
)
LOOK = 0.5  # seconds between two looks at how far the jobs are
PATIENCE = 60.0  # seconds in which one job must end
PAGE = 100  # jobs
GROWTH = 1.0  # MiB in 100 jobs, once the first 100 are done, above which memory counts as growing
HANGING = 80  # requests that need the store while it hangs: twice an API's threads
ROOM = 96  # MiB that a process may take more of, however many large uploads there are
MIB = 2**20


@dataclass(frozen=True)
class Load:
    """What comes: so many jobs, so many a second on average; so many large uploads; a store that hangs so long."""

    engine: str = "real"
    jobs: int = 500
    rate: float = 0.5
    workers: int = 2
    uploads: int = 4
    upload_mib: int = 200
    hang: float = 30.0
    arrivals: str = "poisson"
    asset: Path | None = None
    evaluate: str = "none"

    @property
    def worker_command(self) -> list[str]:
        return WORKER_COMMAND if self.engine == "fast" else [sys.executable, "-m", "worker"]

    def due(self) -> list[float]:
        """The seconds after the beginning at which the jobs come."""
        draw = random.Random(0)
        even = self.arrivals == "even"
        return [*accumulate(1 / self.rate if even else draw.expovariate(self.rate) for _ in range(self.jobs))]

    def request(self, number: int) -> dict[str, Any]:
        """No two are alike, so that each is work."""
        if self.engine == "fast":
            file, parameters = ("asset.obj", asset(number=number)), dict[str, Any](text=f"J{number}")
        else:
            file = (self.asset.name, self.asset.read_bytes()) if self.asset else ("box.obj", BOX.encode())
            parameters = {"text": "watermark", "seed": number, "evaluate": self.evaluate}
        return {"files": {"file": file}, "data": {"params": json.dumps(parameters)}}

    def large(self, number: int) -> bytes:
        """An asset of nearly so many MiB, of which no two are alike; all but a box in it is what nothing refers to."""
        if self.engine == "fast":
            return asset(number=number).ljust(self.upload_mib * MIB, b"\n")
        return box_glb(random.Random(number).randbytes(self.upload_mib * MIB - 4096))  # the box takes less


def box_glb(filling: bytes) -> bytes:
    """The box as a GLB whose buffer ends in bytes that nothing refers to."""
    lines = [line.split() for line in BOX.splitlines()]
    points = b"".join(struct.pack("<3f", *map(float, line[1:])) for line in lines if line[0] == "v")
    quads = [[int(number) - 1 for number in line[1:]] for line in lines if line[0] == "f"]
    corners = b"".join(struct.pack("<6H", a, b, c, a, c, d) for a, b, c, d in quads)
    binary = points + corners + filling
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)},
        ],
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@dataclass
class Site:
    """All that runs."""

    service: Service
    store: S3
    metrics: str
    api: Process
    workers: list[Process]

    @property
    def processes(self) -> dict[str, Process]:
        return {"API": self.api} | {f"worker {number}": worker for number, worker in enumerate(self.workers, 1)}

    def memory(self) -> dict[str, float]:
        """Resident MiB by process."""
        return {name: psutil.Process(each.popen.pid).memory_info().rss / MIB for name, each in self.processes.items()}


@dataclass(frozen=True)
class Hung:
    """How it went while the store hung."""

    reads: list[float]  # seconds that each answer took which needs no store
    others: Counter[str]  # the codes that all others were answered with, an upload and two HEAD of a file by turns
    longest: float  # seconds until the last of these was answered


@dataclass(frozen=True)
class Sent:
    """How large assets went to the store and became jobs."""

    seconds: list[float]  # of each upload to the store
    before: dict[str, float]  # resident MiB by process
    most: dict[str, float]  # the same, at any time since


@dataclass
class Outcome:
    """What the clients saw, and what there is afterwards."""

    posts: list[float] = field(default_factory=list)  # seconds since each was due
    accepted: list[str] = field(default_factory=list)
    errors: Counter[str] = field(default_factory=Counter)
    memory: list[tuple[int, dict[str, float]]] = field(default_factory=list)  # by jobs that have ended
    jobs: list[dict[str, Any]] = field(default_factory=list)
    hung: Hung | None = None
    sent: Sent | None = None
    complaints: list[str] = field(default_factory=list)


@contextmanager
def running_site(folder: Path, load: Load) -> Iterator[Site]:
    """All servers, one API and the workers."""
    with ExitStack() as stack:
        database = stack.enter_context(postgres_server(durable=True))
        store = stack.enter_context(s3_server())
        metrics_port = free_port()
        service = Service(
            folder,
            broker_url=stack.enter_context(redis_server(folder)),
            database_url=database.new_database(),
            metrics_port=str(metrics_port),
            lease_seconds="15",
            shutdown_seconds="5",
            worker_concurrency="1",
            max_uploads_at_once="0",
            s3_presign="true",
            **store.new_bucket().settings,
        )
        api = Process(API_COMMAND, service.environment, folder / "api.log")
        workers = [
            Process(load.worker_command, service.environment, folder / f"worker {number}.log")
            for number in range(load.workers)
        ]
        for process in (api, *workers):
            process.start()
            stack.callback(process.end, signal.SIGTERM)
        service.client = stack.enter_context(httpx2.Client(base_url=service.url, timeout=20))
        wait_until(service.is_up)
        wait_until(lambda: len(list((folder / "data" / "workers").glob("*"))) == load.workers)
        yield Site(service, store, f"http://127.0.0.1:{metrics_port}/metrics", api, workers)


def run(folder: Path, load: Load) -> Outcome:
    """Let the jobs come, wait for them, and look at what they left."""
    with running_site(folder, load) as site:
        outcome = asyncio.run(_apply(site, load))
        if load.uploads:
            outcome.sent = asyncio.run(_send(site, load, outcome))
        if load.hang:
            outcome.hung = asyncio.run(_hang(site, load, outcome))
        outcome.jobs = _listed(site.service.client)
        _check_jobs(site.service.client, outcome)
        for worker in site.workers:
            worker.end(signal.SIGTERM)
        _check_ends(site, outcome)
    for name, growth in growths(outcome).items():
        if growth > GROWTH:
            outcome.complaints.append(f"the memory of {name} grows by {growth:.1f} MiB in 100 jobs")
    outcome.complaints += [*_of_sending(outcome.sent), *_of_hanging(outcome.hung, load)]
    outcome.complaints += [f"{count} requests ended in {error}" for error, count in outcome.errors.items()]
    return outcome


async def _apply(site: Site, load: Load) -> Outcome:
    outcome, loop = Outcome(), asyncio.get_running_loop()
    unlimited = httpx2.Limits(max_connections=None)
    async with httpx2.AsyncClient(base_url=site.service.url, timeout=60, limits=unlimited) as client:

        async def post(number: int, due: float) -> None:
            await asyncio.sleep(due - loop.time())
            try:
                response = await client.post("/v1/watermarks", **load.request(number))
            except httpx2.TransportError as error:
                outcome.errors[type(error).__name__] += 1
                return
            outcome.posts.append(loop.time() - due)
            if response.status_code == 202:
                outcome.accepted.append(response.json()["id"])
            else:
                outcome.errors[response.json()["code"]] += 1

        began = loop.time() + LOOK
        posts = asyncio.gather(*(post(number, began + due) for number, due in enumerate(load.due())))
        ended, latest = 0, loop.time()
        while not posts.done() or ended < len(outcome.accepted):
            await asyncio.sleep(LOOK)
            accepted = len(outcome.accepted)
            now_ended = accepted - _active((await client.get(site.metrics)).text)
            if now_ended > ended or not posts.done():
                ended, latest = max(ended, now_ended), loop.time()
            elif loop.time() > latest + PATIENCE:
                outcome.complaints.append(f"no job has ended for {PATIENCE:g} seconds, and {accepted - ended} are left")
                break
            outcome.memory.append((ended, site.memory()))
        await posts
    return outcome


async def _hang(site: Site, load: Load, outcome: Outcome) -> Hung:
    """What needs the store and what needs it not, while it takes connections and says nothing."""
    loop = asyncio.get_running_loop()
    codes: Counter[str] = Counter()
    reads: list[float] = []
    unlimited = httpx2.Limits(max_connections=None)
    async with httpx2.AsyncClient(base_url=site.service.url, timeout=10 * PATIENCE, limits=unlimited) as client:
        address = f"/v1/watermarks/{outcome.accepted[0]}"

        async def ask(number: int) -> None:
            if number % 3:
                response = await client.head(f"{address}/model")
            else:
                response = await client.post("/v1/watermarks", **load.request(load.jobs + load.uploads + number))
                outcome.accepted += [response.json()["id"]] if response.status_code == 202 else []
            codes[str(response.status_code)] += 1

        with site.store.hanging():
            began = loop.time()
            asked = asyncio.gather(*map(ask, range(HANGING)))
            while loop.time() < began + load.hang:
                await asyncio.sleep(LOOK)
                for path in ("/healthz", address, "/v1/watermarks"):
                    sent = loop.time()
                    (await client.get(path)).raise_for_status()
                    reads.append(loop.time() - sent)
        await asked
        longest = loop.time() - began
        while _active((await client.get(site.metrics)).text):
            await asyncio.sleep(LOOK)
    return Hung(reads, codes, longest)


def _of_hanging(hung: Hung | None, load: Load) -> Iterator[str]:
    if hung is None:
        return
    if strange := hung.others.keys() - {"200", "202", "503"}:
        yield f"while the store hung, what needs it was answered with {', '.join(strange)}"
    if max(hung.reads) > load.hang / 3:
        yield f"while the store hung, an answer that needs no store took {max(hung.reads):.1f} seconds"


async def _send(site: Site, load: Load, outcome: Outcome) -> Sent:
    """Large assets go to the store itself, all at once, and become jobs, all at once."""
    before, looks = site.memory(), [site.memory()]
    loop, sending = asyncio.get_running_loop(), True

    async def look() -> None:
        while sending:
            await asyncio.sleep(0.1)
            looks.append(site.memory())

    async with httpx2.AsyncClient(base_url=site.service.url, timeout=10 * PATIENCE) as client:

        async def send(number: int) -> float:
            content = await asyncio.to_thread(load.large, number)
            upload = (await client.post("/v1/uploads", json={"size": len(content)})).raise_for_status().json()
            assert upload["url"].startswith(site.store.url), upload
            began = loop.time()
            (await client.put(upload["url"], content=content)).raise_for_status()
            took = loop.time() - began
            parameters = load.request(number)["data"]
            answer = await client.post("/v1/watermarks", data={**parameters, "upload_id": upload["id"]})
            outcome.accepted.append(answer.raise_for_status().json()["id"])
            return took

        looking = asyncio.create_task(look())
        seconds = await asyncio.gather(*map(send, range(load.jobs, load.jobs + load.uploads)))
        while _active((await client.get(site.metrics)).text):
            await asyncio.sleep(LOOK)
        sending = False
        await looking
    most = {name: max(held[name] for held in looks) for name in before}
    return Sent(seconds, before, most)


def _of_sending(sent: Sent | None) -> Iterator[str]:
    if sent is None:
        return
    for name, most in sent.most.items():
        if most > sent.before[name] + ROOM:
            yield f"with large uploads, {name} took {most - sent.before[name]:.0f} MiB more"


def _active(metrics: str) -> int:
    """Jobs that wait or run, as the API's metrics have it."""
    families = text_string_to_metric_families(metrics)
    return sum(int(sample.value) for family in families if family.name == "meshmark_jobs" for sample in family.samples)


def _listed(client: httpx2.Client) -> list[dict[str, Any]]:
    """Every job there is, page by page."""
    jobs: list[dict[str, Any]] = []
    address: str | None = f"/v1/watermarks?limit={PAGE}"
    while address:
        page = client.get(address).json()
        jobs += page["items"]
        address = page["next"]
    return jobs


def _check_jobs(client: httpx2.Client, outcome: Outcome) -> None:
    """Each accepted job is there once and has succeeded at its first attempt, with its files."""
    if sorted(job["id"] for job in outcome.jobs) != sorted(outcome.accepted):
        outcome.complaints.append(f"{len(outcome.accepted)} jobs were accepted, and {len(outcome.jobs)} are listed")
    for job in outcome.jobs:
        if job["state"] != "succeeded" or job["attempts"] != 1 or job["cached"]:
            facts = {name: job[name] for name in ("state", "attempts", "cached", "error")}
            outcome.complaints.append(f"job {job['id']}: {facts}")
            continue
        for kind in ("model", "report", "preview"):
            address = job["links"].get(kind)
            if not address or client.head(address).status_code != 200:
                outcome.complaints.append(f"job {job['id']} has no {kind}")


def _check_ends(site: Site, outcome: Outcome) -> None:
    """Each job was ended once, as the workers' logs have it."""
    ends: Counter[str] = Counter()
    for worker in site.workers:
        for line in worker.log.read_text().splitlines():
            with suppress(json.JSONDecodeError):
                entry = json.loads(line)
                if entry["event"] in ("job succeeded", "job failed"):
                    ends[entry["job"]] += 1
    if ends != Counter(outcome.accepted):
        outcome.complaints.append("the workers' logs do not have one end for each job")


def growths(outcome: Outcome) -> dict[str, float]:
    """MiB in 100 jobs by process: the slope of the line through its memory, once the first 100 jobs are done."""
    warm = [(ended, memory) for ended, memory in outcome.memory if ended >= 100]
    if len({ended for ended, _ in warm}) < 2:
        return {}
    ended = [count for count, _ in warm]
    return {
        name: 100 * statistics.linear_regression(ended, [memory[name] for _, memory in warm]).slope
        for name in warm[0][1]
    }


def report(load: Load, outcome: Outcome) -> str:
    """The figures as Markdown."""
    done = [job for job in outcome.jobs if job["state"] == "succeeded"]
    seconds = [tuple(_moment(job[f"{name}_at"]) for name in ("created", "started", "finished")) for job in done]
    rows = {"POST": outcome.posts}
    rows |= {"waiting": [started - created for created, started, _ in seconds]}
    rows |= {"at work": [finished - started for _, started, finished in seconds]}
    rows |= {"until the result": [finished - created for created, _, finished in seconds]}
    lines = ["| seconds | p50 | p95 | p99 | most |", "| --- | ---: | ---: | ---: | ---: |"]
    lines += [f"| {name} | {' | '.join(map('{:.3f}'.format, _spread(values)))} |" for name, values in rows.items()]
    span = max(finished for *_, finished in seconds) - min(created for created, *_ in seconds)
    facts = [
        f"Engine: {load.engine}{f', {load.asset.name}' if load.asset else ''}; {load.workers} workers of one job each; "
        f"{os.cpu_count()} cores for everything, servers and clients included.",
        f"{load.jobs} jobs came at {load.jobs / load.due()[-1]:.2f} a second ({load.arrivals}); "
        f"{len(done)} were done, at {len(done) / span:.2f} a second from the first arrival to the last end.",
        f"Errors: {sum(outcome.errors.values())}.",
    ]
    if hung := outcome.hung:
        answered = ", ".join(f"{count} with {code}" for code, count in sorted(hung.others.items()))
        facts.append(
            f"While the store hung for {load.hang:g} seconds, {len(hung.reads)} answers that need no store took "
            f"{statistics.median(hung.reads):.3f} seconds at p50 and {max(hung.reads):.3f} at most; of {HANGING} that "
            f"need it, all had an answer after {hung.longest:.1f} seconds: {answered}."
        )
    if sent := outcome.sent:
        taken = ", ".join(f"{name} {sent.before[name]:.0f}, then {sent.most[name]:.0f}" for name in sent.before)
        facts.append(
            f"{load.uploads} uploads of {load.upload_mib} MiB at once by presigned links took "
            f"{min(sent.seconds):.1f} to {max(sent.seconds):.1f} seconds; resident MiB before, and at "
            f"most until their jobs were done: {taken}."
        )
    growth = growths(outcome)
    counts = [count for count in range(0, load.jobs + 1, 100) if count <= outcome.memory[-1][0]]
    memory = [f"| resident MiB after so many jobs | {' | '.join(map(str, counts))} | growth in 100 jobs |"]
    memory += [f"| --- |{' ---: |' * (len(counts) + 1)}"]
    for name in outcome.memory[0][1]:
        at = [next(held[name] for ended, held in outcome.memory if ended >= count) for count in counts]
        grown = f"{growth[name]:+.2f}" if name in growth else "-"
        memory.append(f"| {name} | {' | '.join(map('{:.0f}'.format, at))} | {grown} |")
    return "\n\n".join([*facts, "\n".join(lines), "\n".join(memory), *outcome.complaints])


def _moment(text: str) -> float:
    return datetime.fromisoformat(text).timestamp()


def _spread(values: Sequence[float]) -> list[float]:
    """p50, p95, p99 and the most."""
    cuts = statistics.quantiles(values, n=100, method="inclusive")
    return [cuts[49], cuts[94], cuts[98], max(values)]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.load", description=__doc__)
    default = Load()
    parser.add_argument("--engine", choices=("fast", "real"), default=default.engine)
    parser.add_argument("--jobs", type=int, default=default.jobs)
    parser.add_argument("--rate", type=float, default=default.rate, help="jobs a second (default %(default)s)")
    parser.add_argument("--workers", type=int, default=default.workers)
    parser.add_argument("--uploads", type=int, default=default.uploads, help="large ones, at once, by presigned links")
    parser.add_argument("--upload-mib", type=int, default=default.upload_mib)
    parser.add_argument("--hang", type=float, default=default.hang, help="seconds in which the store says nothing")
    parser.add_argument("--arrivals", choices=("poisson", "even"), default=default.arrivals)
    parser.add_argument("--asset", type=Path, help="for the real engine, in place of the box")
    parser.add_argument("--evaluate", choices=("none", "full"), default=default.evaluate)
    load = Load(**vars(parser.parse_args()))
    before, began = os.getloadavg()[0], time.monotonic()
    with tempfile.TemporaryDirectory(prefix="meshmark-load-") as folder:
        outcome = run(Path(folder), load)
    print(report(load, outcome))
    print(f"\nLoad average {before:.2f} before; {time.monotonic() - began:.0f} seconds in all.")
    return 1 if outcome.complaints else 0


if __name__ == "__main__":
    sys.exit(main())
