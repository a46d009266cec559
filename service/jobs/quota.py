"""Storage quota: the bytes of a tenant's jobs, each counted with all its files, and of its uploads.

The sum of the jobs' files is a column of the tenant's row, changed by the transactions that change those files, always
as the last row that they lock. So it is exact, and needs no query over the jobs, of which there may be millions.
"""

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs.clock import clock
from service.jobs.database import insert_into
from service.jobs.models import Tenant, Upload


def add_stored(session: Session, tenant: str, size: int) -> None:
    """Count bytes that a transaction stores for a tenant; negative ones for those that it removes."""
    if size:
        first = insert_into(session, Tenant).values(id=tenant, created_at=clock(session), stored_bytes=size)
        more = {"stored_bytes": Tenant.stored_bytes + size}
        session.execute(first.on_conflict_do_update(index_elements=["id"], set_=more))


def check_stored(session: Session, tenant: str, most: int) -> None:
    """Refuse an addition just made where its tenant now has more than `most` bytes stored; 0: any number.

    Raises:
        MeshmarkError: ``quota_exceeded``.
    """
    if not most:
        return
    jobs = select(Tenant.stored_bytes).where(Tenant.id == tenant)
    ahead = select(func.sum(Upload.size)).where(Upload.tenant_id == tenant, Upload.expires_at > clock(session))
    stored = (session.scalar(jobs) or 0) + int(session.scalar(ahead) or 0)
    if stored > most:
        raise MeshmarkError(
            ServiceErrorCode.QUOTA_EXCEEDED,
            f"With this, {stored:,} bytes would be stored for you, and {most:,} are the most.",
            "Delete jobs whose files you have fetched, or ask the operator to raise the limit.",
        )
