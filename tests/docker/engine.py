"""A Docker engine of its own in a folder, which leaves this machine as it was."""

import json
import os
import shlex
import shutil
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tests.docker.commands import ROOT, Argument, require, run, say, stop, wait_until

TABLES = ("filter", "nat", "mangle", "raw")
SERVER = ("version", "--format", "{{.Server.Version}}")
FORWARDING = Path("/proc/sys/net/ipv4/ip_forward")


class Engine:
    """A running engine.

    Args:
        folder: where all of it lies.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = {
            "DOCKER_HOST": f"unix://{folder}/docker.sock",
            "DOCKER_CONFIG": f"{folder}/config",  # nobody's credentials, and our plugins
            "DOCKER_BUILDKIT": "1",
            "PATH": f"{folder}/bin:{os.environ['PATH']}",
        }

    def docker(self, *arguments: Argument, check: bool = True, both: bool = False) -> str:
        """What `docker` says."""
        return run(["docker", *arguments], self.environment, check=check, both=both).strip()


@dataclass(frozen=True)
class Footprint:
    """What of this machine an engine changes outside of its folder."""

    links: frozenset[str]
    rules: dict[tuple[str, str], list[str]]
    forwarding: str

    @classmethod
    def now(cls) -> "Footprint":
        """As it is."""
        links = frozenset(path.name for path in Path("/sys/class/net").iterdir())
        programs = [name for name in ("iptables", "ip6tables") if shutil.which(name)]
        rules = {
            (program, table): run([program, "-t", table, "-S"], check=False).splitlines()
            for program in programs
            for table in TABLES
        }
        return cls(links, rules, FORWARDING.read_text())

    def restore(self) -> None:
        """Take away what has come since."""
        for name in Footprint.now().links - self.links:
            run(["ip", "link", "delete", name], check=False)
        for (program, table), lines in Footprint.now().rules.items():
            before = self.rules.get((program, table), [])
            new = [shlex.split(line) for line in lines if line not in before]
            for flag, ours in (("-A", "-D"), ("-N", "-X")):  # rules go before the chains that they stand in
                for line in new:
                    if line[0] == flag:
                        run([program, "-t", table, ours, *line[1:]], check=False)
            for policy in before:
                if policy.startswith("-P"):
                    run([program, "-t", table, *shlex.split(policy)], check=False)
        FORWARDING.write_text(self.forwarding)


@contextmanager
def private_engine(folder: Path) -> Iterator[Engine]:
    """Start an engine whose data lies in a folder, and end it with all that it made elsewhere.

    Raises:
        FailedError: something of it is left.
    """
    daemon, client = _programs()
    before = Footprint.now()
    if _engine_runs():
        stop("another Docker engine runs here; two share no rules. Stop it first: systemctl stop docker.socket docker")
    engine = Engine(folder)
    for name in ("bin", "config"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "bin" / "docker").unlink(missing_ok=True)
    (folder / "bin" / "docker").symlink_to(client)
    configuration = folder / "daemon.json"
    configuration.write_text(
        json.dumps(
            {
                "data-root": f"{folder}/data",
                "exec-root": f"{folder}/exec",
                "pidfile": f"{folder}/docker.pid",
                "hosts": [f"unix://{folder}/docker.sock"],
                "storage-driver": "overlay2",
            }
        )
    )
    try:
        with (folder / "dockerd.log").open("wb") as log:
            process = subprocess.Popen(
                [daemon, "--config-file", configuration], stdout=log, stderr=log, start_new_session=True
            )
        try:
            wait_until(
                "the engine answers, see dockerd.log",
                lambda: process.poll() is not None or engine.docker(*SERVER, check=False),
                60,
            )
            require(process.poll() is None, f"the engine ended:\n{(folder / 'dockerd.log').read_text()[-2000:]}")
            say(f"Docker {engine.docker(*SERVER)} runs in {folder}")
            yield engine
        finally:
            process.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(60)
            process.kill()
    finally:
        _leave_nothing(folder, before)


def _engine_runs() -> bool:
    for path in Path("/proc").glob("[0-9]*/comm"):
        with suppress(OSError):
            if path.read_text().strip() == "dockerd":
                return True
    return False


def _programs() -> tuple[str, str]:
    """The engine and the client that came with it; others may come first in the PATH."""
    found = []
    for name in ("dockerd", "docker"):
        path = next((path for path in (f"/usr/bin/{name}", f"/usr/sbin/{name}") if Path(path).exists()), None)
        path = path or shutil.which(name)
        if path is None:
            stop(f"{name} is not installed: apt-get install docker.io")
        found.append(str(path))
    return found[0], found[1]


def _leave_nothing(folder: Path, before: Footprint) -> None:
    before.restore()
    for line in reversed(Path("/proc/mounts").read_text().splitlines()):
        if (point := line.split()[1]).startswith(f"{folder}/"):
            run(["umount", "--lazy", point], check=False)
    for group in Path("/sys/fs/cgroup").glob("*/docker"):
        with suppress(OSError):  # it is not empty: another engine's
            group.rmdir()
    left = processes_of(folder)
    require(not left, f"processes of the engine are left: {left}")
    now = Footprint.now()
    require(now.links <= before.links, f"bridges are left: {sorted(now.links - before.links)}")
    for key, lines in now.rules.items():
        extra = [line for line in lines if line not in before.rules.get(key, lines)]
        require(not extra, f"rules of {key} are left: {extra}")
    say("no process, bridge or rule of the engine is left")


def processes_of(folder: Path) -> Sequence[str]:
    """Programs whose command line names a folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            command = path.read_bytes().replace(b"\0", b" ").decode(errors="replace")
            if f"{folder}/" in command and int(path.parent.name) not in (os.getpid(), os.getppid()):
                found.append(command)
    return found


def need(group: str) -> None:
    """Have Debian's packages of a group installed, or end with their names."""
    done = subprocess.run(["sh", ROOT / "docker" / "system-packages.sh", group], check=False)
    if done.returncode:
        stop(f"the packages named above are missing; {group} cannot be had without")
