"""Cache of results: the engine is deterministic, so the same bytes and parameters need no second run.

A tenant gets only its own results: whether another tenant had an asset watermarked is confidential.
"""

from collections.abc import Mapping
from typing import Any

from sqlalchemy import or_, select
from sqlalchemy.orm import Session, sessionmaker

from core import __version__
from core.artwork.layout import serving_fonts
from core.parameters import Parameters
from service.jobs.clock import clock
from service.jobs.copies import UNREPEATED
from service.jobs.idempotency import fingerprint
from service.jobs.ledger import OUTPUTS, Content
from service.jobs.models import ArtifactKind, Job, JobState


def result_key(
    parameters: dict[str, Any], contents: Mapping[ArtifactKind, Content], signed: bool = False
) -> str | None:
    """Cache key of a job's results; None while its asset is not known."""
    if ArtifactKind.INPUT not in contents:
        return None
    inputs = {kind.value: content.sha256 for kind, content in contents.items()}
    # Other fonts installed, other letters. The ones that stand in for a font that was sent are among these.
    wording = Parameters.model_validate(parameters).resolved()
    fonts = serving_fonts(wording.text, wording.language)
    more = {"signed": True} if signed else {}
    return fingerprint({"engine": __version__, "parameters": parameters, "fonts": fonts, **more, **inputs})


def copy_key(parameters: Parameters, text: str, signed: bool) -> str:
    """Cache key of the results of a copy with this text of a job with these parameters, beside its files.

    It holds for an asset, a font, a logo and a plan that are known only once the job has succeeded.
    """
    wording = parameters.model_copy(update={"text": text}).resolved()
    fonts = serving_fonts(wording.text, wording.language)
    asked = parameters.model_dump(mode="json") | UNREPEATED | {"text": text}
    return fingerprint({"engine": __version__, "copy": asked, "fonts": fonts, "signed": signed})


def find_results(sessions: sessionmaker[Session], tenant: str, key: str | None) -> dict[ArtifactKind, Content]:
    """Results of the tenant's latest succeeded job with this key, as far as they are still stored; else none."""
    if key is None:
        return {}
    with sessions() as session:
        done = (
            Job.tenant_id == tenant,
            Job.result_key == key,
            Job.state == JobState.SUCCEEDED,
            or_(Job.expires_at.is_(None), Job.expires_at > clock(session)),
        )
        job = session.scalar(select(Job).where(*done).order_by(Job.created_at.desc()).limit(1))
    return {item.kind: Content(item.sha256, item.size) for item in job.artifacts if item.kind in OUTPUTS} if job else {}
