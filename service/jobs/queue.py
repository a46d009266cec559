"""The queues between service and worker: their names, the task's name, and how to reach the broker.

A message is a job's id and nothing else, and says that a job waits in this job's queue. It may be lost or
arrive twice, because the ledger alone decides which job starts: see :mod:`service.jobs.turns`.
"""

import json
import os
import time
import uuid
from pathlib import Path
from typing import Any, ClassVar

from celery import Celery
from kombu.entity import Queue as BrokerQueue
from kombu.exceptions import OperationalError
from kombu.transport import TRANSPORT_ALIASES, filesystem

from service.config import Settings
from service.jobs.models import Queue

LONGEST_WAIT = 0.2  # seconds in which a worker that waits for messages notices that it is to stop
TASK = "meshmark.watermark"
TRANSPORT_ALIASES |= dict.fromkeys(("redis", "rediss"), "service.jobs.redis_transport:Transport")


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
    """Celery app that can send; the worker adds the parts that receive."""
    queue = Celery("meshmark", broker=settings.broker_url, set_as_current=False)
    queue.conf.update(
        task_queues=[*map(BrokerQueue, map(name, Queue))],
        task_default_queue=name(Queue.SMALL),
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
            "priority_steps": [0],  # one list each queue: priorities are the ledger's
            "socket_timeout": 10,
            "socket_connect_timeout": 3,
        }
    return queue


def name(queue: Queue) -> str:
    """Broker's name of a queue."""
    return f"meshmark.{queue}"


def queue_for(settings: Settings, size: int | None) -> Queue:
    """Queue of a job whose asset has so many bytes; None: not known yet, so it may be large."""
    if size is None:
        return Queue.LARGE
    if settings.gpu_asset_bytes and size >= settings.gpu_asset_bytes:
        return Queue.GPU
    return Queue.LARGE if size >= settings.large_asset_bytes else Queue.SMALL


def send(broker: Celery, job_id: str, queue: Queue) -> None:
    """Announce to the workers that a job waits in a queue.

    Raises:
        kombu.exceptions.OperationalError: the broker cannot be reached.
    """
    broker.send_task(TASK, args=[job_id], queue=name(queue))


def depth(broker: Celery, queue: Queue) -> int:
    """Number of messages that wait in the broker.

    Raises:
        kombu.exceptions.OperationalError: the broker cannot be reached.
    """
    with broker.connection_for_write() as connection:
        try:
            with connection.channel() as channel:
                return int(channel.queue_declare(name(queue), durable=True, auto_delete=False).message_count)
        except connection.connection_errors as error:
            raise OperationalError(str(error)) from error
