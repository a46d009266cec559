"""Rate limit of an API key's requests, and limit of a tenant's active jobs."""

from sqlalchemy import case, func, select, update
from sqlalchemy.orm import Session, sessionmaker

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs.clock import clock
from service.jobs.models import ApiKey, Job, Tenant
from service.jobs.transitions import ACTIVE

MINUTE = 60.0  # seconds


def spend(sessions: sessionmaker[Session], key_id: str, per_minute: int) -> float:
    """Take a request from a key's bucket; returns 0, or the seconds until there is one to take.

    The bucket holds a minute's requests and fills evenly. It is kept as one number, the moment at which it will be full
    again, as the generic cell rate algorithm does (ITU-T I.371): each request moves that moment on by its share of a
    minute. One conditional UPDATE looks and takes, so that any number of API processes share the bucket.
    """
    share = MINUTE / per_minute
    while True:
        with sessions() as session:
            moment = clock(session).timestamp()
        full = case((ApiKey.spent_until > moment, ApiKey.spent_until), else_=moment) + share
        there = (ApiKey.id == key_id, ApiKey.spent_until <= moment + MINUTE - share)
        with sessions.begin() as session:
            if session.scalar(update(ApiKey).where(*there).values(spent_until=full).returning(ApiKey.id)):
                return 0.0
            spent_until = session.scalar(select(ApiKey.spent_until).where(ApiKey.id == key_id)) or 0.0
            # As the clock is now: others may have been waited for since the moment above.
            later = clock(session).timestamp()
        if (wait := spent_until - (later + MINUTE - share)) > 0:
            return wait
        if not spent_until:  # the key is gone
            return 0.0


def check_active(session: Session, tenant: str, most: int) -> None:
    """Refuse a job just added where its tenant now has more than `most` that have not ended.

    The tenant's row is locked before the jobs are counted, so that no two requests take the same last place; SQLite has
    one writer at a time anyhow.

    Raises:
        MeshmarkError: ``too_many_jobs``.
    """
    session.execute(select(Tenant.id).where(Tenant.id == tenant).with_for_update(key_share=True))
    active = select(func.count()).where(Job.tenant_id == tenant, Job.state.in_(ACTIVE))
    if (session.scalar(active) or 0) > most:
        raise MeshmarkError(
            ServiceErrorCode.TOO_MANY_JOBS,
            f"{most:,} jobs of yours wait or run, the most at a time.",
            "Send the asset again when some of them have ended, or ask the operator to raise the limit.",
        )
