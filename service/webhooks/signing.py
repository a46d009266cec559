"""Secrets and signatures of webhooks: Standard Webhooks, "Signature scheme", symmetric (`v1`, HMAC-SHA256)."""

import base64
import binascii
import hashlib
import hmac
import secrets as randomness
from collections.abc import Sequence
from datetime import datetime

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode

PREFIX = "whsec_"
SECRET_BYTES = 32  # of a new secret
SHORTEST, LONGEST = 24, 64  # bytes, by the specification


def new_secret() -> str:
    """Draw a random secret in its written form."""
    return PREFIX + base64.b64encode(randomness.token_bytes(SECRET_BYTES)).decode()


def parse_secret(text: str) -> bytes:
    """Key in a written secret.

    Raises:
        MeshmarkError: ``invalid_secret``. The message does not repeat it.
    """
    try:
        key = base64.b64decode(text.removeprefix(PREFIX), validate=True) if text.startswith(PREFIX) else b""
    except (binascii.Error, ValueError):
        key = b""
    if not SHORTEST <= len(key) <= LONGEST:
        raise MeshmarkError(
            ServiceErrorCode.INVALID_SECRET,
            f"The secret is not `{PREFIX}` and the base64 of {SHORTEST} to {LONGEST} bytes.",
            "Leave it out to have one made, or write one in that form.",
        )
    return key


def sign(secrets: Sequence[str], message_id: str, sent_at: datetime, body: bytes) -> dict[str, str]:
    """Headers that authenticate a message: one signature per secret, so that secrets can be rotated.

    Args:
        secrets: the endpoint's secrets in their written form, the newest first.
        message_id: the same at every attempt, so that receivers recognize repetitions; without a dot, the separator in
            the signed text.
        sent_at: the time of this attempt, aware.
        body: exactly the bytes that are sent.

    Raises:
        MeshmarkError: ``invalid_secret``.
        ValueError: there is no secret, or a dot in the id.
    """
    if not secrets or "." in message_id:
        raise ValueError("a webhook is signed with at least one secret, and its id has no dot")
    timestamp = str(int(sent_at.timestamp()))
    signed = f"{message_id}.{timestamp}.".encode() + body
    signatures = (hmac.digest(parse_secret(secret), signed, hashlib.sha256) for secret in secrets)
    return {
        "webhook-id": message_id,
        "webhook-timestamp": timestamp,
        "webhook-signature": " ".join(f"v1,{base64.b64encode(signature).decode()}" for signature in signatures),
    }
