import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from service.config import Settings
from service.jobs.models import Queue
from service.jobs.queue import create_queue, send
from tests.service.harness import API_COMMAND, Service, free_port, redis_server, running
from tests.worker.waiting import PATIENCE, wait_until
from worker import pulse as module
from worker.pulse import Pulse, check

WORKER = [sys.executable, "-m", "tests.worker.apps"]
LEASE = 10.0  # a worker has stopped consuming after two of them, and is reported after four


def settings(folder: Path) -> Settings:
    return Settings(data_dir=folder, lease_seconds=LEASE)


class Clock:
    """The time of the worker and of whoever looks at its sign of life: it goes on with its beats only."""

    def __init__(self) -> None:
        self.now = 1e9

    def time(self) -> float:
        return self.now

    monotonic = time

    def beat(self, pulse: Pulse, seconds: float) -> None:
        for _ in range(round(seconds / LEASE * 4)):
            pulse.path.unlink(missing_ok=True)
            before = self._touched
            pulse.beat()
            self._touched = self.now if pulse.path.exists() else before
            pulse.path.touch()
            os.utime(pulse.path, (self._touched, self._touched))
            self.now += LEASE / 4

    _touched = 0.0


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    return clock


def test_an_idle_worker_is_well(tmp_path: Path, clock: Clock) -> None:
    clock.beat(Pulse(settings(tmp_path), create_queue(settings(tmp_path))), 6 * LEASE)
    assert check(settings(tmp_path)) is None


def test_a_worker_that_leaves_messages_waiting_beside_a_free_place_is_not(tmp_path: Path, clock: Clock) -> None:
    broker = create_queue(settings(tmp_path))
    pulse = Pulse(settings(tmp_path), broker)
    send(broker, "job", Queue.SMALL)
    clock.beat(pulse, LEASE)
    assert check(settings(tmp_path)) is None
    clock.beat(pulse, 7 * LEASE)
    assert f"process id {os.getpid()} has stopped" in str(check(settings(tmp_path)))
    pulse.began()
    clock.beat(pulse, LEASE / 4)
    assert check(settings(tmp_path)) is None


def test_a_busy_worker_is_well_however_many_messages_wait(tmp_path: Path, clock: Clock) -> None:
    broker = create_queue(settings(tmp_path))
    pulse = Pulse(settings(tmp_path), broker)
    pulse.began()
    send(broker, "job", Queue.SMALL)
    clock.beat(pulse, 7 * LEASE)
    assert check(settings(tmp_path)) is None


def test_a_broker_that_is_down_is_not_the_workers_fault(tmp_path: Path) -> None:
    down = settings(tmp_path).model_copy(update={"broker_url": f"redis://127.0.0.1:{free_port()}/0"})
    Pulse(down, create_queue(down)).beat()
    assert check(settings(tmp_path)) is None


def test_what_dead_processes_left_does_not_count(tmp_path: Path) -> None:
    assert check(settings(tmp_path)) == "No worker runs here."
    ended = subprocess.Popen(["true"])
    ended.wait()
    pulse = Pulse(settings(tmp_path), create_queue(settings(tmp_path)))
    old = pulse.path.with_name(pulse.path.name.replace(str(os.getpid()), str(ended.pid)))
    old.touch()
    assert check(settings(tmp_path)) == "No worker runs here."
    Pulse(settings(tmp_path), create_queue(settings(tmp_path)))
    assert not old.exists()


@pytest.fixture
def broker_port() -> int:
    return free_port()


def test_a_worker_goes_on_after_its_broker_lost_everything_and_the_probe_tells_a_halted_one(
    tmp_path: Path, broker_port: int
) -> None:
    service = Service(tmp_path, broker_url=f"redis://127.0.0.1:{broker_port}/0", lease_seconds="1")

    def probe() -> int:
        return subprocess.run([*WORKER, "--check"], env=os.environ | service.environment, timeout=PATIENCE).returncode

    with service.running(API_COMMAND):
        assert probe() == 1
        with running(WORKER, service.environment) as worker:
            for _ in range(2):
                with redis_server(tmp_path, broker_port):
                    service.wait_for(service.start_job(), "succeeded")
                    wait_until(lambda: probe() == 0)
            wait_until(lambda: probe() == 0)
            worker.send_signal(signal.SIGSTOP)
            wait_until(lambda: probe() == 1)
            worker.send_signal(signal.SIGCONT)
            wait_until(lambda: probe() == 0)


def test_a_worker_whose_broker_goes_while_all_its_places_are_taken_takes_messages_again(
    tmp_path: Path, broker_port: int
) -> None:
    service, go = Service(tmp_path, broker_url=f"redis://127.0.0.1:{broker_port}/0"), tmp_path / "go"
    with service.running(API_COMMAND, WORKER):
        with redis_server(tmp_path, broker_port):
            url = service.start_job(wait_for=os.fspath(go))
            wait_until(lambda: service.job(url)["stage"] == "placing")
        go.touch()  # the job ends, and nobody is there to be told
        service.wait_for(url, "succeeded")
        time.sleep(1)
        with redis_server(tmp_path, broker_port):
            assert service.wait_for(service.start_job(), "succeeded")["attempts"] == 1
