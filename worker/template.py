"""Template process that the processes of jobs are forked from: `python -m worker.template ENGINE`, one per worker."""

import importlib
import socket
import sys
from functools import partial

from service import template
from worker import child


class Template(template.Template):
    """Owner's handle of it, in the worker.

    Args:
        engine: as "module:function". The module has a function ``preload`` too, which imports what the other will need.
        threads: number that a job may use.
    """

    def __init__(self, engine: str, threads: int) -> None:
        super().__init__([sys.executable, "-m", "worker.template", engine], threads, "engine")


def main() -> None:
    """Import the engine and serve."""
    name, _, function = sys.argv[1].partition(":")
    module = importlib.import_module(name)
    module.preload()
    template.serve(socket.socket(fileno=sys.stdin.fileno()), partial(child.main, getattr(module, function)))


if __name__ == "__main__":
    main()
