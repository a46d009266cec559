"""Uploads: assets sent ahead of the requests that use them, by a presigned PUT to the store, or through the service.

An upload is a row, and a file in the store under the row's id. It becomes a job's input as any other asset does: it is
read, counted, hashed and checked each time it is named, so content that a client puts into the bucket is never trusted,
and it may be used any number of times. Whether or not it was used, it expires; then the file is removed before the row.
Both are kept for GRACE beyond, in which no new use begins, so that nothing is put after its removal.
"""

import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from itertools import chain

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session, sessionmaker

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs.artifacts import GRACE, ArtifactStore, Staged
from service.jobs.clock import now
from service.jobs.models import Tenant, Upload
from service.jobs.quota import check_stored

LIFETIME = timedelta(hours=24)  # of an upload
LINK_LIFETIME = timedelta(hours=1)  # of the presigned URL that it is sent to

Sessions = sessionmaker[Session]


def begin(
    sessions: Sessions, tenant: str, filename: str, size: int, sha256: str | None, most: int, most_bytes: int = 0
) -> Upload:
    """Create an upload, unless its tenant has `most` of them (0: any number) or more than `most_bytes` stored (0: any).

    Raises:
        MeshmarkError: ``too_many_uploads``; ``quota_exceeded``.
    """
    moment = now()
    upload = Upload(
        id=str(uuid.uuid4()),
        tenant_id=tenant,
        filename=filename,
        size=size,
        sha256=sha256,
        created_at=moment,
        expires_at=moment + LIFETIME,
    )
    with sessions.begin() as session:
        session.add(upload)
        session.flush()
        session.execute(select(Tenant.id).where(Tenant.id == tenant).with_for_update(key_share=True))
        held = select(func.count()).where(Upload.tenant_id == tenant, Upload.expires_at > moment)
        if most and (session.scalar(held) or 0) > most:
            raise MeshmarkError(
                ServiceErrorCode.TOO_MANY_UPLOADS,
                f"{most:,} uploads of yours have not expired, the most at a time.",
                "Use one of them, or begin a new one when some have expired.",
            )
        check_stored(session, tenant, most_bytes)
    return upload


def find(sessions: Sessions, tenant: str, upload_id: str) -> Upload:
    """Find a tenant's upload.

    Raises:
        MeshmarkError: ``not_found``; ``upload_expired``.
    """
    upload = None
    if upload_id.isprintable():  # PostgreSQL takes no NUL
        with sessions() as session:
            upload = session.scalar(select(Upload).where(Upload.id == upload_id, Upload.tenant_id == tenant))
    if upload is None:
        raise MeshmarkError(
            ServiceErrorCode.NOT_FOUND,
            f"There is no upload {upload_id[:64]!r}.",
            "Use the id that POST /v1/uploads gave.",
        )
    if upload.expires_at <= now():
        raise _expired()
    return upload


def receive(store: ArtifactStore, upload: Upload, chunks: Iterable[bytes]) -> None:
    """Store the content of an upload, in place of earlier content.

    Raises:
        MeshmarkError: ``upload_mismatch``, it has not the declared size or SHA-256; ``upload_expired``.
    """
    with _verified(store, upload, chunks) as staged:
        if upload.expires_at <= now():
            raise _expired()
        store.put_upload(upload.id, staged)


@contextmanager
def stage(store: ArtifactStore, upload: Upload) -> Iterator[Staged]:
    """Stage the content of an upload on the local disk; see :meth:`ArtifactStore.stage`.

    Raises:
        MeshmarkError: ``upload_not_sent``; ``upload_mismatch``.
    """
    chunks = store.read_upload(upload.id)
    try:
        first = next(chunks, b"")
    except FileNotFoundError:
        raise MeshmarkError(
            ServiceErrorCode.UPLOAD_NOT_SENT,
            "Nothing has been sent to this upload yet.",
            "PUT the asset to the upload's `url` first.",
        ) from None
    with _verified(store, upload, chain([first], chunks)) as staged:
        yield staged


def remove_expired(sessions: Sessions, store: ArtifactStore, limit: int = 100) -> None:
    """Remove expired uploads, those that expired first."""
    old = select(Upload.id).where(Upload.expires_at < now() - timedelta(seconds=GRACE))
    with sessions() as session:
        expired = list(session.scalars(old.order_by(Upload.expires_at).limit(limit)))
    for upload_id in expired:
        store.remove_upload(upload_id)
        with sessions.begin() as session:
            session.execute(delete(Upload).where(Upload.id == upload_id))


@contextmanager
def _verified(store: ArtifactStore, upload: Upload, chunks: Iterable[bytes]) -> Iterator[Staged]:
    """Stage received chunks, and check them against the declared size and SHA-256."""
    some_more = upload.size + 1
    with store.stage_chunks(_at_most(some_more, chunks), limit=some_more, name="upload") as staged:
        if staged.size != upload.size:
            arrived = f"{staged.size:,} bytes" if staged.size < upload.size else "more"
            raise _mismatch(f"{upload.size:,} bytes were declared for this upload, but {arrived} arrived.")
        if upload.sha256 not in (None, staged.sha256):
            raise _mismatch("What arrived has another SHA-256 than was declared for this upload.")
        yield staged


def _at_most(size: int, chunks: Iterable[bytes]) -> Iterator[bytes]:
    for chunk in chunks:
        yield chunk[:size]
        size -= len(chunk)
        if size <= 0:
            return


def _mismatch(message: str) -> MeshmarkError:
    return MeshmarkError(
        ServiceErrorCode.UPLOAD_MISMATCH, message, "Send the whole asset again, or begin a new upload."
    )


def _expired() -> MeshmarkError:
    return MeshmarkError(
        ServiceErrorCode.UPLOAD_EXPIRED, "The upload has expired.", "Begin a new upload, and send it again."
    )
