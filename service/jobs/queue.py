"""The queue between service and worker: its name, the task's name, and how to reach the broker.

A message is a job's id, and in its headers what logs and traces are joined by; it may be lost or arrive twice, because
the ledger alone decides.
"""

import json
import os
import time
import uuid
from pathlib import Path
from typing import Any, ClassVar

from celery import Celery
from kombu.transport import filesystem

from service.config import Settings
from service.correlation import outgoing

LONGEST_WAIT = 0.2  # seconds
QUEUE = "meshmark"
TASK = "meshmark.watermark"


class AtomicChannel(filesystem.Channel):
    """kombu's file broker, except that a message appears under its name only when it is whole.

    kombu writes in place and reads without the lock, so a worker can meet half a message and stop on it.
    """

    def _put(self, queue: str, payload: Any, **_: Any) -> None:  # type: ignore[override]
        folder = Path(self.data_folder_out)
        draft = folder / f".{uuid.uuid4()}.draft"
        draft.write_text(json.dumps(payload))
        draft.rename(folder / f"{time.time_ns()}_{uuid.uuid4()}.{queue}.msg")


class FileTransport(filesystem.Transport):
    """The transport behind `filesystem://`."""

    Channel = AtomicChannel
    default_connection_params: ClassVar[dict[str, Any]] = {}  # there is no host to connect to

    def drain_events(self, connection: Any, timeout: float | None = None, **_: Any) -> None:
        """Wait for messages, but not for long: a worker that is told to stop does so when this returns."""
        super().drain_events(connection, timeout and min(timeout, LONGEST_WAIT))  # type: ignore[no-untyped-call]


def create_queue(settings: Settings) -> Celery:
    """A Celery app that can send; the worker adds what it needs to receive."""
    queue = Celery("meshmark", broker=settings.broker_url, set_as_current=False)
    queue.conf.update(
        task_default_queue=QUEUE,
        task_serializer="json",
        accept_content=["json"],
        task_ignore_result=True,
        broker_connection_retry_on_startup=True,
        # A job that could not be announced is found by the sweeper; the request does not wait for the broker.
        task_publish_retry=False,
    )
    if settings.broker_url.startswith("filesystem:"):
        messages, control = (settings.data_dir.resolve() / "broker" / name for name in ("messages", "control"))
        messages.mkdir(parents=True, exist_ok=True)
        control.mkdir(parents=True, exist_ok=True)
        queue.conf.broker_transport = f"{__name__}:FileTransport"
        queue.conf.broker_transport_options = {
            "data_folder_in": os.fspath(messages),
            "data_folder_out": os.fspath(messages),
            "control_folder": os.fspath(control),
            "polling_interval": 0.1,
        }
    else:
        queue.conf.broker_transport_options = {
            # Redis hands an unacknowledged message out again after this long; by then no job can still run.
            "visibility_timeout": 2 * settings.job_time_limit + 600,
            "socket_timeout": 10,
            "socket_connect_timeout": 3,
        }
    return queue


def send(queue: Celery, job_id: str) -> None:
    """Announce a queued job to the workers.

    Raises:
        kombu.exceptions.OperationalError: the broker cannot be reached.
    """
    queue.send_task(TASK, args=[job_id], queue=QUEUE, headers=outgoing())


def depth(queue: Celery) -> int:
    """How many messages wait in the broker."""
    with queue.connection_for_write() as connection, connection.channel() as channel:
        return int(channel.queue_declare(QUEUE, durable=True, auto_delete=False).message_count)
