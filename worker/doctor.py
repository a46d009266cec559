"""Findings of `meshmark doctor` about what the service needs. pyproject.toml names them: core knows no worker."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import redis

from core.doctor import Finding, State, space
from service.config import Settings, load_settings
from worker import sandbox

TIMEOUT = 3.0  # seconds that Redis has to answer


def findings() -> Iterator[Finding]:
    """Settings, sandbox, queue and data folder, one by one."""
    try:
        settings = load_settings()
    except SystemExit:  # each setting that cannot work is on standard error
        yield Finding("settings", State.MISSING, "The service's settings are not valid.", "Correct those named above.")
        return
    yield shut_in(settings)
    yield queue(settings)
    yield space("data folder", settings.data_dir)


def shut_in(settings: Settings) -> Finding:
    """The sandbox of the worker's child processes."""
    with tempfile.TemporaryDirectory() as folder:
        lacking = [part for part, there in sandbox.probe(Path(folder), ()).items() if not there]
    if not lacking:
        return Finding("sandbox", State.OK, "Workers shut the engine off from network and files.")
    return Finding(
        "sandbox",
        State.MISSING if settings.sandbox == "required" else State.OPTIONAL,
        f"Workers cannot shut the engine off from: {', '.join(lacking)}.",
        "It takes Linux 5.13 with Landlock and seccomp on x86-64 or ARM64; or set MESHMARK_SANDBOX=auto.",
    )


def queue(settings: Settings) -> Finding:
    """The broker of jobs."""
    address = urlsplit(settings.broker_url)
    if not address.scheme.startswith("redis"):
        return Finding("queue", State.OK, "Jobs are queued as files in the data folder, without Redis.")
    where = f"{address.hostname}:{address.port or 6379}"  # the rest of the address may hold a password
    try:
        with redis.Redis.from_url(
            settings.broker_url, socket_timeout=TIMEOUT, socket_connect_timeout=TIMEOUT
        ) as broker:
            broker.ping()
    except (redis.RedisError, ValueError) as error:
        return Finding(
            "queue",
            State.MISSING,
            f"Redis at {where} does not answer ({type(error).__name__}).",
            "Start it, or correct MESHMARK_BROKER_URL.",
        )
    return Finding("queue", State.OK, f"Redis at {where} answers.")
