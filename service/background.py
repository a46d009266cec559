"""Essential background threads: if one dies, the process exits, and its supervisor restarts it.

Without one of them, a process would look healthy and not do its work. A panic of a native library raises a
BaseException, which no `except Exception` catches.
"""

import os
import threading
from collections.abc import Callable
from contextvars import copy_context
from typing import NoReturn

import structlog

DIED = 70  # exit code after the death of a thread: EX_SOFTWARE of sysexits.h

log = structlog.get_logger(__name__)


def in_background(name: str, work: Callable[..., object], *arguments: object) -> threading.Thread:
    """Run work in a daemon thread, in the caller's context (of the log, of traces); whatever it raises ends the
    process."""

    def run() -> None:
        try:
            work(*arguments)
        except BaseException as error:
            end_process(error)

    thread = threading.Thread(target=copy_context().run, args=(run,), name=name, daemon=True)
    thread.start()
    return thread


def end_process(error: BaseException) -> NoReturn:
    """Exit at once, for an error of the current thread: after a panic, no cleanup can be relied on."""
    log.critical("a thread died, and the process ends with it", thread=threading.current_thread().name, exc_info=error)
    os._exit(DIED)
