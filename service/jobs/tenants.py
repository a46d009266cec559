"""Tenants and their API keys.

A key is `mm_<id>_<secret>`. Of the secret only its SHA-256 is kept: it has 256 random bits, which
cannot be guessed, so a slow password hash would cost every request much and add nothing.
"""

import hashlib
import re
import secrets
import string
from collections.abc import Iterable
from datetime import datetime, timedelta
from enum import StrEnum
from hmac import compare_digest
from typing import NamedTuple

from sqlalchemy import select, update
from sqlalchemy.orm import Session, sessionmaker

from service.jobs.clock import now
from service.jobs.models import ApiKey, Tenant

DIGITS = string.digits + string.ascii_letters
ID_LENGTH, SECRET_LENGTH = 8, 43  # characters; 62 ** 43 > 2 ** 256
KEY = re.compile(rf"mm_([0-9A-Za-z]{{{ID_LENGTH}}})_([0-9A-Za-z]{{{SECRET_LENGTH}}})")
TENANT = re.compile(r"[a-z0-9][a-z0-9-]{0,62}")
COARSE = timedelta(minutes=1)  # resolution of a key's last use

Sessions = sessionmaker[Session]


class Scope(StrEnum):
    """Scope of an API key."""

    READ = "jobs:read"
    WRITE = "jobs:write"


class NewKey(NamedTuple):
    """A key just made, and its text, which is never seen again."""

    row: ApiKey
    text: str


def create_key(
    sessions: Sessions, tenant: str, name: str, scopes: Iterable[Scope], expires_at: datetime | None = None
) -> NewKey:
    """Create a key of a tenant, which is created with its first key.

    Raises:
        ValueError: the tenant's name cannot be one.
    """
    if not TENANT.fullmatch(tenant):
        raise ValueError(f"{tenant!r} is no tenant: take at most 63 lower-case letters, digits and hyphens")
    identity, secret = _random(ID_LENGTH), _random(SECRET_LENGTH)
    row = ApiKey(
        id=identity,
        tenant_id=tenant,
        name=name,
        secret_sha256=_digest(secret),
        scopes=sorted(scopes),
        created_at=now(),
        expires_at=expires_at,
    )
    with sessions.begin() as session:
        if session.get(Tenant, tenant) is None:
            session.add(Tenant(id=tenant, created_at=now()))
            session.flush()
        session.add(row)
    return NewKey(row, f"mm_{identity}_{secret}")


def list_keys(sessions: Sessions, tenant: str | None = None) -> list[ApiKey]:
    """Keys of a tenant, or of all of them; revoked ones too."""
    keys = select(ApiKey).order_by(ApiKey.tenant_id, ApiKey.created_at)
    with sessions() as session:
        return list(session.scalars(keys if tenant is None else keys.where(ApiKey.tenant_id == tenant)))


def revoke_key(sessions: Sessions, identity: str) -> bool:
    """Revoke a key, for good and at once; False where there is no valid key of that id."""
    key = (ApiKey.id == identity, ApiKey.revoked_at.is_(None))
    with sessions.begin() as session:
        return bool(session.scalar(update(ApiKey).where(*key).values(revoked_at=now()).returning(ApiKey.id)))


def authenticate(sessions: Sessions, text: str) -> ApiKey | None:
    """Look a key up by its text; None where it is malformed, unknown, revoked or expired."""
    match = KEY.fullmatch(text)
    if match is None:
        return None
    with sessions() as session:
        key = session.get(ApiKey, match[1])
    if key is None or not compare_digest(key.secret_sha256, _digest(match[2])):
        return None
    if key.revoked_at or (key.expires_at and key.expires_at <= now()):
        return None
    return key


def note_use(sessions: Sessions, key: ApiKey) -> None:
    """Record that a key is in use."""
    if key.last_used_at is None or key.last_used_at < now() - COARSE:
        with sessions.begin() as session:
            session.execute(update(ApiKey).where(ApiKey.id == key.id).values(last_used_at=now()))


def _random(length: int) -> str:
    return "".join(secrets.choice(DIGITS) for _ in range(length))


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()
