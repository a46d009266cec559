"""`python -m worker PID`: the worker of the embedded service; it ends with the process PID that started it."""

import sys

from celery import Celery

from worker.child import die_with_parent


def main(app: Celery, parent: int) -> None:
    """Run the worker until a signal ends it or its parent is gone."""
    die_with_parent(parent)
    app.worker_main(["--quiet", "worker", "--without-gossip", "--without-mingle", "--without-heartbeat"])


if __name__ == "__main__":
    from worker.app import app

    main(app, int(sys.argv[1]))
