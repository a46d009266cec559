"""`python -m worker [PID]`: a worker; given a process, it ends with it, as that of the embedded service does."""

import sys
import warnings

from celery import Celery
from celery.exceptions import SecurityWarning

from worker.child import die_with_parent


def main(app: Celery, parent: int | None) -> None:
    """Run the worker until a signal ends it or its parent, where one is given, is gone."""
    if parent is not None:
        die_with_parent(parent)
    # Harmless here, where messages are JSON and never pickles; Celery still refuses to start as root with pickles.
    warnings.filterwarnings("ignore", "You're running the worker with superuser privileges", SecurityWarning)
    app.worker_main(["--quiet", "worker", "--without-gossip", "--without-mingle", "--without-heartbeat"])


if __name__ == "__main__":
    from worker.app import app

    main(app, int(sys.argv[1]) if sys.argv[1:] else None)
