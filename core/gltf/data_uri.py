"""Bytes inside a URI (RFC 2397), as exporters write them."""

import base64
import binascii
import re
from typing import Any, TypeGuard
from urllib.parse import unquote_to_bytes

_SCHEME = re.compile(r"\s*data:", re.IGNORECASE)
_BASE64 = re.compile(r";\s*base64\s*$", re.IGNORECASE)
_URL_SAFE = bytes.maketrans(b"-_", b"+/")
_BLANKS = b" \t\r\n\f\v"


def is_data_uri(uri: Any) -> TypeGuard[str]:
    """True where a URI holds its bytes itself."""
    return isinstance(uri, str) and _SCHEME.match(uri) is not None


def decode_data_uri(uri: str) -> bytes:
    """The bytes in a data URI: percent-encoded, or base64 of either alphabet, padded or not, blanks in it or not.

    Raises:
        ValueError: for any other content.
    """
    header, comma, payload = uri.partition(",")
    if not comma:
        raise ValueError("a data URI has a comma before its data")
    raw = unquote_to_bytes(payload) if "%" in payload else payload.encode()
    if not _BASE64.search(header):
        return raw
    digits = raw.translate(_URL_SAFE, _BLANKS).rstrip(b"=")
    try:
        return base64.b64decode(digits + b"=" * (-len(digits) % 4), validate=True)
    except binascii.Error as error:
        raise ValueError(str(error)) from None
