"""The header Idempotency-Key (draft-ietf-httpapi-idempotency-key-header)."""

import re

from core.errors import ErrorCode, MeshmarkError

QUOTED = re.compile(r'"((?:[ !#-\[\]-~]|\\["\\])*)"')  # a string of RFC 9651
BARE = re.compile(r"[!#-~]+")  # what most clients send
LONGEST = 255  # characters of a key


def parse_idempotency_key(header: str) -> str:
    """Key in a header, with or without quotes.

    Raises:
        MeshmarkError: ``invalid_request``.
    """
    quoted = QUOTED.fullmatch(header)
    key = re.sub(r"\\(.)", r"\1", quoted[1]) if quoted else header if BARE.fullmatch(header) else ""
    if not 1 <= len(key) <= LONGEST:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            f"The Idempotency-Key is not 1 to {LONGEST} printable ASCII characters.",
            "Send a random UUID, or another text that no other request of yours has.",
        )
    return key
