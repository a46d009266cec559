"""`make docker-test`: the deployment as it is documented, built and run for real by a Docker engine of its own.

It needs root on Debian or Ubuntu, 12 GB of disk and port 8080, and no other engine that runs. What is missing is
installed, or named. Base images are pulled; where no registry answers, they are made of Debian's and PyPI's packages.
In the end this machine is as it was before. With a folder as CACHE what was downloaded and built is kept there.
"""

import argparse
import os
import shutil
import signal
import socket
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from tests.docker import drills, images
from tests.docker.commands import FailedError, require, say, stop, wait_until
from tests.docker.deployment import ADDRESS, Client, Deployment
from tests.docker.engine import Engine, need, private_engine

TAG = "meshmark:0.1-cpu"
ROOM = 12e9  # bytes


def main() -> None:
    """Build, run, break and end it, and print what came of each."""
    parser = argparse.ArgumentParser(prog="make docker-test", description=__doc__)
    parser.add_argument("--cache", type=Path, help="keep what was downloaded and built in this folder")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("docker-test: stopped"))
    if os.geteuid() != 0:
        stop("a Docker engine needs root: sudo make docker-test")
    need("docker")
    with suppress(OSError), socket.create_connection(ADDRESS, timeout=1):
        stop(f"port {ADDRESS[1]} is taken, and the deployment publishes it: end what listens there")
    try:
        with _folder(options.cache) as folder, private_engine(folder / "engine") as engine:
            done = _deploy(engine, folder)
    except FailedError as error:
        say(f"FAILED: {error}")
        sys.exit(1)
    say("passed")
    for name, outcome in done.items():
        print(f"{'':10}{name}: {outcome}")


@contextmanager
def _folder(cache: Path | None) -> Iterator[Path]:
    """Where everything lies; its name is short, as those of sockets have to be."""
    if cache:
        cache.mkdir(parents=True, exist_ok=True)
    folder = cache.resolve() if cache else Path(tempfile.mkdtemp(prefix="meshmark-"))
    try:
        if not (folder / "engine" / "data").exists() and shutil.disk_usage(folder).free < ROOM:
            stop(f"{folder} has less than {ROOM / 1e9:.0f} GB free: name another with TMPDIR or CACHE")
        yield folder
    finally:
        if not cache:
            shutil.rmtree(folder)


def _deploy(engine: Engine, folder: Path) -> dict[str, str]:
    """What came of each drill.

    Raises:
        FailedError: one or more failed; the last lines of all logs at that moment are printed.
    """
    downloads, own = folder / "downloads", folder / "deployment"
    shutil.rmtree(own, ignore_errors=True)
    for path in (downloads, own):
        path.mkdir(exist_ok=True)
    images.have_compose(engine, downloads)
    stack = Deployment(engine, own)
    weights = images.have_all(engine, downloads, TAG, stack.images())
    done: dict[str, str] = {}
    try:
        stack.up()
        client = Client("")
        wait_until("the API serves", client.is_up)
        say("the stack is up")
        create = ("python", "-m", "service", "keys", "create", "--tenant", "acme", "--name", "first")
        client.key = stack.compose("exec", "-T", "api", *create)
        rounds: list[dict[str, drills.Drill]] = [  # the drills of a round run at the same time
            {
                "all metrics": partial(drills.everything_measured, client, weights),
                "hook": partial(drills.hook, stack, client),
                "no way to the host": partial(drills.no_way_to_the_host, stack),
            },
            {"large uploads": partial(drills.large_uploads, client)},
            {"worker killed": partial(drills.killed_worker, stack, client)},
            {"redis restarted": partial(drills.restarted, stack, client, "redis")},
            {"postgres restarted": partial(drills.restarted, stack, client, "postgres")},
            {"store restarted": partial(drills.restarted, stack, client, "store")},
            {"stop and start": partial(drills.stopped_and_started, stack, client)},
            {"nothing lost": partial(drills.ended_once, client), "logs": partial(drills.logs, stack)},
            {"down": partial(drills.taken_down, stack)},
        ]
        failed = []
        for plan in rounds:
            for name, outcome in _at_once(plan).items():
                if isinstance(outcome, FailedError):  # later rounds are tried all the same: what failed shows better
                    failed.append(f"{name}: {outcome}")
                    say(f"FAILED {failed[-1]}")
                    print(stack.compose("ps", "--all", check=False, both=True))
                    print(stack.compose("logs", "--tail", "40", check=False, both=True), flush=True)
                else:
                    done[name] = outcome
        require(not failed, "; ".join(failed))
    finally:
        stack.compose("down", "--volumes", "--timeout", "5", check=False, both=True)
    done["one container"] = drills.one_container(engine, TAG, own)
    say(f"one container: {done['one container']}")
    done["one processor"] = drills.one_processor(engine, TAG)
    done["layers"] = _layers(engine)
    return done


def _at_once(plan: dict[str, drills.Drill]) -> dict[str, str | FailedError]:
    """What came of drills that run at the same time, by name."""

    def outcome(name: str) -> str | FailedError:
        try:
            text = plan[name]()
        except FailedError as error:
            return error
        say(f"{name}: {text}")
        return text

    with ThreadPoolExecutor(len(plan)) as pool:
        return dict(zip(plan, pool.map(outcome, plan), strict=True))


def _layers(engine: Engine) -> str:
    """The sizes of the image and of its layers, the last first."""
    layers = [
        line.partition(" ")
        for line in engine.docker("history", "--format", "{{.Size}} {{.CreatedBy}}", TAG).splitlines()
    ]
    parts = [f"{size} {step[:48].strip() or 'the base'}" for size, _, step in layers if size != "0B"]
    total = int(engine.docker("image", "inspect", "--format", "{{.Size}}", TAG))
    return f"{total / 1e6:,.0f} MB: " + "; ".join(parts)


if __name__ == "__main__":
    main()
