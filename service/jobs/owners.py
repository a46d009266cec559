"""Watermarks of a tenant whose texts were read on a suspect file: whose copy it is.

A verification looks for a few known texts, and takes what is nearly one of them for it. Texts of copies are nearly
alike, and there may be thousands: here each reading, as it was read, is compared with all of them, by a library that
takes a fraction of a second for it.
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from rapidfuzz.distance import Indel
from rapidfuzz.process import cdist
from sqlalchemy import select
from sqlalchemy.orm import Session, sessionmaker

from core.verify.texts import enough
from service.jobs.models import Job, JobKind

LATEST = 10_000  # jobs that are looked through
MOST_READINGS, LONGEST_READING = 64, 400  # of a file, and characters of each
MOST = 20  # texts that are told


class Owner(NamedTuple):
    """A text that was read: its likeness to the best reading, the readings to which no other is more alike, and the
    jobs that have it, the newest first."""

    text: str
    likeness: float
    readings: int
    jobs: tuple[Job, ...]


def owners(sessions: sessionmaker[Session], tenant: str, readings: Sequence[str]) -> list[Owner]:
    """The texts of a tenant's watermarks that were read, the likeliest first: that which most readings are nearest to,
    and of equal ones the most alike.

    Args:
        sessions: of the ledger.
        tenant: whose watermarks are looked through, the latest.
        readings: texts of marks as they were read.
    """
    said = Job.parameters["text"].as_string()
    mine = (Job.tenant_id == tenant, Job.kind == JobKind.WATERMARK, ~Job.erased)
    latest = select(Job.id, said).where(*mine).order_by(Job.created_at.desc(), Job.id.desc()).limit(LATEST)
    jobs = defaultdict[str, list[str]](list)
    with sessions() as session:
        for job_id, text in session.execute(latest):
            if text and text.strip():
                jobs[text.strip()].append(job_id)
        best, nearest = _matched(list(jobs), readings)
        told = sorted(best, key=lambda text: (-nearest[text], -best[text], text))[:MOST]
        wanted = [job_id for text in told for job_id in jobs[text][:MOST]]
        found = {job.id: job for job in session.scalars(select(Job).where(Job.id.in_(wanted)))}
    return [
        Owner(text, best[text], nearest[text], tuple(found[each] for each in jobs[text][:MOST] if each in found))
        for text in told
    ]


def _matched(texts: Sequence[str], readings: Sequence[str]) -> tuple[dict[str, float], dict[str, int]]:
    """By text, its likeness to the best of the ``readings``, of texts that are like enough to one; and the number of
    readings to which no other text is more alike."""
    readings = [plain for each in readings[:MOST_READINGS] if (plain := _plain(each[:LONGEST_READING]))]
    if not texts or not readings:
        return {}, {}
    alike = cdist(readings, [_plain(text) for text in texts], scorer=Indel.normalized_similarity, dtype=np.float64)
    likely = alike >= np.array([enough(text) for text in texts])
    top = np.where(likely, alike, 0.0).max(axis=1, keepdims=True)
    best, nearest = alike.max(axis=0), (likely & (alike == top)).sum(axis=0)
    found = np.flatnonzero(likely.any(axis=0)).tolist()
    return {texts[each]: float(best[each]) for each in found}, {texts[each]: int(nearest[each]) for each in found}


def _plain(text: str) -> str:
    """A text without regard to case and spaces."""
    return "".join(text.casefold().split())
