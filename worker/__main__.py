"""`python -m worker [--queues small,large] [PID]`: a worker, for all queues or for some; `--check` looks after it.

Given a process, it ends with it, as that of the embedded service does.
"""

import argparse
import sys

from celery import Celery

from service.config import load_settings
from service.jobs.models import Queue
from service.jobs.queue import name
from worker.child import die_with_parent
from worker.pulse import check
from worker.receiving import run_until_stopped


def main(app: Celery) -> None:
    """Run a worker as the command line says, until a signal ends it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--queues", type=_queues, help=f"which to serve, of {','.join(Queue)}; by default all")
    parser.add_argument("parent", type=int, nargs="?", metavar="PID", help="end with this process")
    parser.add_argument("--check", action="store_true", help="say whether the workers here take messages, and end")
    arguments = parser.parse_args()
    if arguments.check:
        sys.exit(check(load_settings()))  # 0, or 1 and a sentence on stderr
    if arguments.parent is not None:
        die_with_parent(arguments.parent)
    queues = ["--queues", ",".join(map(name, arguments.queues))] if arguments.queues else []
    run_until_stopped(app, *queues)


def _queues(text: str) -> list[Queue]:
    return [Queue(word) for word in text.split(",")]


if __name__ == "__main__":
    from worker.app import app

    main(app)
