"""Encryption of webhook secrets in the ledger, where there are keys (Fernet: AES-128 in CBC mode and HMAC).

The keys are in a file, one a line. The first one encrypts and all of them decrypt, so that keys can be changed while
processes run that know only the old ones. Without a file, secrets are stored and read in clear; with one, those in
clear from before are read and encrypted when a process starts.
"""

from collections.abc import Sequence
from pathlib import Path

from cryptography.fernet import Fernet, InvalidToken, MultiFernet
from sqlalchemy import select, update
from sqlalchemy.orm import Session, sessionmaker

from service.jobs.models import WebhookEndpoint
from service.webhooks.signing import PREFIX

PAGE = 100  # endpoints in one transaction


class UnreadableSecretError(Exception):
    """None of the keys decrypts a secret."""


def read_keys(path: Path | None) -> list[Fernet]:
    """Read the keys in a file; none without one.

    Raises:
        ValueError: it cannot be read, or a line of it is no key; the message has none of it.
    """
    if path is None:
        return []
    try:
        lines = path.read_text().split()
    except (OSError, UnicodeError):
        raise ValueError(f"{path} cannot be read") from None
    if not lines:
        raise ValueError(f"{path} has no key")
    try:
        return [Fernet(line) for line in lines]
    except ValueError:
        raise ValueError(f"{path} has a line that is no Fernet key: 32 bytes in URL-safe base64") from None


class Vault:
    """Encrypts secrets for storage, and decrypts stored ones."""

    def __init__(self, keys: Sequence[Fernet]) -> None:
        self._keys = keys

    def seal(self, secret: str) -> str:
        """Encrypt a secret for storage."""
        return self._keys[0].encrypt(secret.encode()).decode() if self._keys else secret

    def unseal(self, stored: str) -> str:
        """Decrypt a stored secret.

        Raises:
            UnreadableSecretError: it is encrypted with another key.
        """
        if stored.startswith(PREFIX):
            return stored
        if not self._keys:
            raise UnreadableSecretError
        try:
            return MultiFernet(self._keys).decrypt(stored).decode()
        except InvalidToken:
            raise UnreadableSecretError from None

    def renewed(self, stored: str) -> str:
        """Re-encrypt a stored secret; the same, where it is encrypted with the first key, or there is none.

        Raises:
            UnreadableSecretError: it is encrypted with another key.
        """
        secret = self.unseal(stored)
        try:
            for key in self._keys[:1]:
                key.decrypt(stored)
        except InvalidToken:
            return self.seal(secret)
        return stored


def renew_secrets(sessions: sessionmaker[Session], vault: Vault) -> None:
    """Store every secret as the vault would seal it today.

    Raises:
        UnreadableSecretError: one of them cannot be read; the message is a sentence that names its endpoint.
    """
    last = ""
    while True:
        page = select(WebhookEndpoint).where(WebhookEndpoint.id > last).order_by(WebhookEndpoint.id).limit(PAGE)
        with sessions.begin() as session:
            rows = list(session.scalars(page))
            for row in rows:
                try:
                    secret = vault.renewed(row.secret)
                    former = row.former_secret and vault.renewed(row.former_secret)
                except UnreadableSecretError:
                    raise UnreadableSecretError(
                        f"The secret of the webhook endpoint {row.id} is encrypted with none of the keys here: "
                        "MESHMARK_SECRETS_KEY has to name the file of the keys that were used."
                    ) from None
                if (secret, former) != (row.secret, row.former_secret):
                    # Unless it was rotated since: then it is stored as it is to be already.
                    same = (WebhookEndpoint.id == row.id, WebhookEndpoint.secret == row.secret)
                    renewed = update(WebhookEndpoint).where(*same).values(secret=secret, former_secret=former)
                    session.execute(renewed.execution_options(synchronize_session=False))
        if not rows:
            return
        last = rows[-1].id
