"""Verification of webhooks that the service sends (Standard Webhooks, symmetric signatures)."""

import base64
import binascii
import hashlib
import hmac
import json
import time
from collections.abc import Mapping, Sequence
from typing import Any

PREFIX = "whsec_"
SHORTEST = 24  # bytes of a secret
TOLERANCE = 300.0  # seconds that a message may be old, or ahead, so that one that was overheard cannot be sent later


class InvalidWebhookError(Exception):
    """The message is not one that the service sent just now: answer it with 400."""


def verify_webhook(headers: Mapping[str, str], body: bytes, secret: str | Sequence[str]) -> dict[str, Any]:
    """The message of a webhook, once it is certain that the service sent it: `type`, `timestamp` and `data`, the job.

    Args:
        headers: of the request, however they are capitalized.
        body: of the request, exactly as it came.
        secret: of the endpoint, `whsec_...`; several while it is being changed.

    Raises:
        InvalidWebhookError: a header is missing, no signature is by a secret, or the message is too old.
        ValueError: a secret is not one.
    """
    given = {name.lower(): value for name, value in headers.items()}
    try:
        identity, sent_at = given["webhook-id"], given["webhook-timestamp"]
        signatures = given["webhook-signature"].split()
    except KeyError as missing:
        raise InvalidWebhookError(f"The header {missing.args[0]} is missing.") from None
    signed = f"{identity}.{sent_at}.".encode() + body
    keys = [_key(text) for text in ([secret] if isinstance(secret, str) else secret)]
    expected = [b"v1," + base64.b64encode(hmac.digest(key, signed, hashlib.sha256)) for key in keys]
    shown = [signature.encode() for signature in signatures]
    if not any(hmac.compare_digest(one, other) for one in expected for other in shown):
        raise InvalidWebhookError("No signature is by the secret.")
    if not sent_at.isascii() or not sent_at.isdigit() or abs(time.time() - int(sent_at)) > TOLERANCE:
        raise InvalidWebhookError("The message was not sent within the last minutes, or the clocks differ.")
    message: dict[str, Any] = json.loads(body)
    return message


def _key(secret: str) -> bytes:
    try:
        key = base64.b64decode(secret.removeprefix(PREFIX), validate=True)
    except binascii.Error:
        key = b""
    if len(key) < SHORTEST:  # with an empty one, anybody could sign
        raise ValueError(f"The secret is not `{PREFIX}` and the base64 of {SHORTEST} bytes or more.")
    return key
