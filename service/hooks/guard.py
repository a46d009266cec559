"""Authentication of notifications, by token or HMAC signature."""

import hashlib
import hmac
from collections.abc import Mapping

from service.errors import ServiceErrorCode
from service.hooks.config import HookSource
from service.problems import ProblemError


def check_token(source: HookSource, headers: Mapping[str, str]) -> None:
    """Refuse a request without the source's token, where it has one. Compared in constant time.

    MinIO sends its token as `Bearer <token>`, other senders as they were told to.

    Raises:
        ProblemError: ``invalid_hook_token``.
    """
    if source.token is None:
        return
    shown = headers.get(source.token_header, "")
    scheme, _, rest = shown.partition(" ")
    token = rest.strip() if scheme.lower() == "bearer" else shown
    if not _same(token, source.token.get_secret_value()):
        raise _refusal(f"The header {source.token_header} does not have the token of this hook.")


def check_signature(source: HookSource, headers: Mapping[str, str], body: bytes) -> None:
    """Refuse a request whose body the source did not sign (HMAC-SHA256 in hexadecimal), where it has to.

    Raises:
        ProblemError: ``invalid_hook_token``.
    """
    if source.hmac_secret is None:
        return
    expected = hmac.new(source.hmac_secret.get_secret_value().encode(), body, hashlib.sha256).hexdigest()
    if not _same(headers.get(source.hmac_header, "").removeprefix("sha256=").lower(), expected):
        raise _refusal(f"The header {source.hmac_header} does not have a signature of this body by this hook's secret.")


def _same(shown: str, expected: str) -> bool:
    return hmac.compare_digest(shown.encode("latin-1", "replace"), expected.encode())


def _refusal(message: str) -> ProblemError:
    return ProblemError(
        ServiceErrorCode.INVALID_HOOK_TOKEN,
        message,
        "Configure the sender as the hooks file says.",
        {"WWW-Authenticate": "Bearer", "Connection": "close"},
    )
