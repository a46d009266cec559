"""The engine's process between two jobs: it has read the asset of the first, and makes copies of it.

A worker that has made one copy is asked for the next within a moment, of the same asset at the same places. Each stays
a job of its own, with its lease, its limits and its end; what ends a process ends only the copy that it makes.
"""

import shutil
from pathlib import Path
from types import TracebackType
from typing import Self

from service.jobs.copies import SHARED
from service.jobs.models import Job
from worker.runner import Limits, Session, Work
from worker.template import Template

Inputs = list[tuple[str, str]]


class Series:
    """The process of the present job, and after its success for as long as copies of it follow."""

    def __init__(self) -> None:
        self._session: Session | None = None
        self._inputs: Inputs | None = None  # of the copies that it waits for

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()

    @property
    def waits(self) -> bool:
        """True where a process waits for a copy."""
        return self._inputs is not None

    def start(self, template: Template, work: Work, limits: Limits) -> Session:
        """A new process for a job.

        Raises:
            StoreUnavailableError: the disk under its folder is full.
        """
        self._session = Session(template, work, limits)
        return self._session

    def go_on(self, job: Job, folder: Path) -> Session | None:
        """The process that waits, asked for a copy in a new folder. None, and it is ended, if it waits for others, has
        died, or has taken too much."""
        session, waits_for, self._inputs = self._session, self._inputs, None
        if session is None or job.copy_of is None or _inputs(job) != waits_for or not session.may_go_on():
            self.end()
            return None
        try:
            session.folder.rename(folder)  # it can write in no other
            _clear(folder)
        except OSError:  # a sweeper was quicker
            shutil.rmtree(folder, ignore_errors=True)
            self.end()
            return None
        session.go_on(job.parameters, folder)
        return session

    def keep(self, job: Job) -> None:
        """Let the process of a job that has succeeded wait for copies."""
        self._inputs = _inputs(job)

    def end(self) -> None:
        """End the process, if there is one."""
        if self._session is not None:
            self._session.close()
            shutil.rmtree(self._session.folder, ignore_errors=True)
        self._session = self._inputs = None


def _inputs(job: Job) -> Inputs:
    """The tenant and the files that all copies of a job have, and the job itself under other names."""
    names = SHARED | {kind: kind for kind in SHARED.values()}
    return [("tenant", job.tenant_id), *sorted((names[f.kind], f.sha256) for f in job.artifacts if f.kind in names)]


def _clear(folder: Path) -> None:
    """Remove the results of the copy before: they shall not be taken for those of the next."""
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
