"""The texts that a tenant marks with, which its verifications look for."""

from sqlalchemy import select
from sqlalchemy.orm import Session, sessionmaker

from core.parameters import Parameters
from core.verify.parameters import MOST_TEXTS
from service.jobs.models import Job, JobKind

LATEST = 200  # jobs that are looked through


def known_texts(sessions: sessionmaker[Session], tenant: str) -> list[str]:
    """Different texts of a tenant's latest watermarks, the newest first; none where there are no such jobs.

    A text is what was embossed: the words of a label where the client sent none of its own.
    """
    mine = (Job.tenant_id == tenant, Job.kind == JobKind.WATERMARK, ~Job.erased)
    latest = select(Job.parameters).where(*mine).order_by(Job.created_at.desc(), Job.id.desc()).limit(LATEST)
    with sessions() as session:
        parameters = list(session.scalars(latest))
    texts = (Parameters.model_validate(each).resolved().text.strip() for each in parameters)
    return list(dict.fromkeys(filter(None, texts)))[:MOST_TEXTS]
