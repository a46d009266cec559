"""`python -m tests.attacks`: one tenant attacks an API, another measures what is left for it; prints both.

A real API process with its defaults (SQLite, files), attackers in processes of their own, and one client that asks for
its list of jobs fifty times a second and now and then sends a small asset. Real attackers sit at other machines: here
they run only where a processor is idle, so that what they do themselves takes little from the service. Seconds depend
on the machine: run it on one that is idle, and compare the rows with the first.
"""

import argparse
import json
import multiprocessing as mp
import os
import socket
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.synchronize import Event
from pathlib import Path

import httpx2

from service.config import Settings
from service.jobs.ledger import Ledger
from service.jobs.tenants import Scope, create_key
from tests.core.formats.samples import zipped
from tests.load import BOX
from tests.service.harness import API_COMMAND, Service

PACE = 0.02  # seconds between the questions of the client
UPLOADS = 5  # small assets that it sends during an attack
COLLADA = b'<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">%s</COLLADA>'


class Victim:
    """The address that is attacked, and the key of the attacker."""

    def __init__(self, port: int, key: str) -> None:
        self.port, self.key = port, key

    def client(self) -> httpx2.Client:
        return httpx2.Client(
            base_url=f"http://127.0.0.1:{self.port}", headers={"Authorization": f"Bearer {self.key}"}, timeout=300
        )

    def line(self, data: bytes) -> socket.socket:
        line = socket.create_connection(("127.0.0.1", self.port), timeout=30)
        line.sendall(data)
        return line

    def head(self, request: str, *headers: str) -> bytes:
        lines = [f"{request} HTTP/1.1", "Host: a", f"Authorization: Bearer {self.key}", *headers, "", ""]
        return "\r\n".join(lines).encode()


Attack = Callable[[Victim, Event], None]


def _again(threads: int, step: Callable[[httpx2.Client], object]) -> Attack:
    """``step`` again and again in so many threads."""

    def attack(victim: Victim, over: Event) -> None:
        def loop() -> None:
            with victim.client() as client:
                while not over.is_set():
                    with suppress(httpx2.TransportError):
                        step(client)

        crew = [threading.Thread(target=loop, daemon=True) for _ in range(threads)]
        for each in crew:
            each.start()
        over.wait()

    return attack


def _posting(clients: int, content: bytes, name: str) -> Attack:
    form = {"params": json.dumps({"text": "A"})}
    return _again(clients, lambda client: client.post("/v1/watermarks", data=form, files={"file": (name, content)}))


def _lines(count: int, data: Callable[[Victim], bytes]) -> Attack:
    """So many connections that send this and then nothing; those that are closed are opened again."""

    def attack(victim: Victim, over: Event) -> None:
        lines: list[socket.socket] = []
        while not over.is_set():
            while len(lines) < count and not over.is_set():
                with suppress(OSError):
                    lines.append(victim.line(data(victim)))
            over.wait(1)
            for line in lines[: count // 10]:
                line.close()
            del lines[: count // 10]

    return attack


def _one_byte_chunks(victim: Victim, over: Event) -> None:
    with victim.client() as client:
        upload = client.post("/v1/uploads", json={"size": 10**7}).json()
    head = victim.head(f"PUT {upload['url']}", "Transfer-Encoding: chunked")
    while not over.is_set():
        with suppress(OSError):
            line = victim.line(head)
            while not over.is_set():
                line.sendall(b"1\r\nx\r\n" * 2000)


def attacks(clients: int) -> dict[str, Attack]:
    """The attacks of one tenant, by name; each of so many clients sends a request as soon as its last is answered."""
    stalled = b"--X\r\nContent-Disposition: form-data; name=file; filename=a.glb\r\n\r\n" + b"x" * 2_200_000
    keys = b'{"size":1,' + b",".join(b'"%d":1' % number for number in range(160_000)) + b"}"
    wide = COLLADA % b"<a %b/>" % b" ".join(b'a%x=""' % number for number in range(2 * 10**6))
    return {
        "a DAE of 20 million elements": _posting(clients, zipped({"a.dae": COLLADA % (b"<a/>" * 20 * 10**6)}), "a.zip"),
        "a DAE element of 2 million attributes": _posting(clients, zipped({"a.dae": wide}), "a.zip"),
        "JSON of 160,000 keys": _again(
            clients,
            lambda client: client.post("/v1/uploads", content=keys, headers={"Content-Type": "application/json"}),
        ),
        "40 uploads that stand still": _lines(
            40,
            lambda victim: (
                victim.head(
                    "POST /v1/watermarks", "Content-Type: multipart/form-data; boundary=X", "Content-Length: 90000000"
                )
                + stalled
            ),
        ),
        "300 requests that never end": _lines(300, lambda _victim: b"GET /healthz HTTP/1.1\r\nHost: a\r\nX-a: "),
        "chunks of one byte": _one_byte_chunks,
        "uploads of 40 MB": _again(
            clients,
            lambda client: client.post(
                "/v1/watermarks", data={"params": '{"text": "A"}'}, files={"file": ("a.obj", b"\n" * 40_000_000)}
            ),
        ),
    }


def measured(client: httpx2.Client, seconds: float) -> list[float]:
    """Seconds that each question took, asked at an even pace."""
    times: list[float] = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        start = time.monotonic()
        client.get("/v1/watermarks").raise_for_status()
        times.append(time.monotonic() - start)
        time.sleep(max(0.0, PACE - times[-1]))
    return times


def sent(client: httpx2.Client, name: str) -> list[float]:
    """Seconds until each of a few small assets was accepted."""
    times = []
    for number in range(UPLOADS):
        start = time.monotonic()
        box = f"# {name} {number}\n{BOX}".encode()
        answer = client.post(
            "/v1/watermarks", data={"params": '{"text": "watermark"}'}, files={"file": ("box.obj", box)}
        )
        assert answer.status_code == 202, answer.text
        times.append(time.monotonic() - start)
    return times


def row(name: str, gets: list[float], posts: list[float]) -> str:
    p50, p99 = (statistics.quantiles(gets, n=100)[each - 1] for each in (50, 99))
    return (
        f"| {name} | {1e3 * p50:.1f} | {1e3 * p99:.1f} | {1e3 * max(gets):.0f} "
        f"| {1e3 * statistics.median(posts):.0f} | {1e3 * max(posts):.0f} |"
    )


def _aside(attack: Attack, victim: Victim, over: Event) -> None:
    """The attack, by a process that gives way to every other one."""
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    attack(victim, over)


@contextmanager
def under(attack: Attack, victim: Victim) -> Iterator[None]:
    """While an attack runs, in a process of its own."""
    over = mp.Event()
    process = mp.Process(target=_aside, args=(attack, victim, over), daemon=True)
    process.start()
    try:
        yield
    finally:
        over.set()
        process.join(2)
        process.kill()
        process.join()


def main() -> None:
    """Run every attack for a while, and print a row for each."""
    parser = argparse.ArgumentParser(prog="python -m tests.attacks", description=__doc__)
    parser.add_argument("--seconds", type=float, default=8.0, help="of each attack (default %(default)s)")
    parser.add_argument("--clients", type=int, default=4, help="of the attacker, where one request is one attack")
    options = parser.parse_args()
    mp.set_start_method("fork")
    with tempfile.TemporaryDirectory(prefix="meshmark-attacks-") as folder:
        service = Service(Path(folder), auth="keys", log_level="WARNING")
        with service.running(API_COMMAND):
            ledger = Ledger(Settings(data_dir=Path(folder) / "data").ledger_url)
            keys = [create_key(ledger.sessions, name, name, [*Scope], None).text for name in ("alice", "bobby")]
            ledger.close()
            port = int(service.environment["MESHMARK_PORT"])
            victim = Victim(port, keys[0])
            print(f"Load average before: {os.getloadavg()[0]:.2f}; {os.cpu_count()} processors.\n")
            print("| attack | GET p50 [ms] | p99 | most | POST of a box, median [ms] | most |")
            print("| --- | ---: | ---: | ---: | ---: | ---: |")
            with Victim(port, keys[1]).client() as client:
                sent(client, "warm")
                print(row("none", measured(client, options.seconds), sent(client, "idle")), flush=True)
                for name, attack in attacks(options.clients).items():
                    with under(attack, victim):
                        time.sleep(1)
                        gets = measured(client, options.seconds)
                        posts = sent(client, name)
                    print(row(name, gets, posts), flush=True)


if __name__ == "__main__":
    main()
