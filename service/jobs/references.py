"""References of the ledger's rows to content in the store.

A row is written while its content is there, and content is removed while no row refers to it; a lock on the content's
hash keeps the two apart: see :mod:`service.jobs.contents`.
"""

from collections.abc import Callable, Iterable

from sqlalchemy import select
from sqlalchemy.orm import Session, sessionmaker

from service.jobs.locks import lock_keys
from service.jobs.models import Artifact


class MissingContentError(Exception):
    """The store does not have the content that a row was to refer to."""


def lock_content(session: Session, hashes: Iterable[str], stored: Callable[[str], bool]) -> None:
    """Begin a transaction in which this content stays in the store; `stored` tests whether the store has it.

    Raises:
        MissingContentError: it does not have all of it.
    """
    wanted = set(hashes)
    lock_keys(session, map(_key, wanted))
    if not all(map(stored, wanted)):
        raise MissingContentError


def unreferenced(sessions: sessionmaker[Session], hashes: Iterable[str]) -> set[str]:
    """Select those hashes that no job refers to at the moment."""
    candidates = set(hashes)
    with sessions() as session:
        return candidates - set(session.scalars(select(Artifact.sha256).where(Artifact.sha256.in_(candidates))))


def discard(sessions: sessionmaker[Session], sha256: str, remove: Callable[[str], None]) -> None:
    """Remove content unless a job refers to it; no job can begin to meanwhile."""
    with sessions.begin() as session:
        lock_keys(session, {_key(sha256)})
        if session.scalar(select(Artifact.job_id).where(Artifact.sha256 == sha256).limit(1)) is None:
            remove(sha256)


def _key(sha256: str) -> int:
    return int(sha256[:15], 16)  # 60 bits: a key is a signed 64-bit integer
