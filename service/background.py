"""Threads that a process cannot do without: where one dies, the process ends, and whoever supervises it starts another.

A process that goes on without one of them looks well and does not do its work. Native libraries panic, and what comes
of that is a BaseException, which no `except Exception` catches.
"""

import os
import threading
from collections.abc import Callable
from contextvars import copy_context
from typing import NoReturn

import structlog

DIED = 70  # the exit code: EX_SOFTWARE of sysexits.h

log = structlog.get_logger(__name__)


def in_background(name: str, work: Callable[..., object], *arguments: object) -> threading.Thread:
    """Do something in a thread of its own, in the log's context of now; whatever it raises ends the process."""

    def run() -> None:
        try:
            work(*arguments)
        except BaseException as error:
            end_process(error)

    thread = threading.Thread(target=copy_context().run, args=(run,), name=name, daemon=True)
    thread.start()
    return thread


def end_process(error: BaseException) -> NoReturn:
    """End the process at once, for what its thread of now met: after a panic nothing can be relied on to end well."""
    log.critical("a thread died, and the process ends with it", thread=threading.current_thread().name, exc_info=error)
    os._exit(DIED)
