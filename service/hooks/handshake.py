"""Registration of CloudEvents senders (CloudEvents, "HTTP 1.1 Web Hooks for Event Delivery" 1.0, section 4).

A sender asks before it sends, so that it cannot be abused to flood a server that expects nothing. This does not
authenticate the sender: see :mod:`service.hooks.guard`.
"""

from collections.abc import Mapping

from service.errors import ServiceErrorCode
from service.hooks.config import HookSource
from service.problems import ProblemError


def grant(source: HookSource, headers: Mapping[str, str]) -> dict[str, str]:
    """Headers that permit the asking sender to send, at any rate.

    Raises:
        ProblemError: ``method_not_allowed``, the source is not configured for this sender, or the request names none.
    """
    origin = headers.get("WebHook-Request-Origin", "")
    if origin.lower() not in source.origins:
        raise ProblemError(
            ServiceErrorCode.METHOD_NOT_ALLOWED,
            "The header WebHook-Request-Origin names no sender that this hook lets ask whether it may send.",
            "The operator can add the sender to the `origins` of the hook.",
            {"Allow": "POST"},
        )
    return {"Allow": "POST", "WebHook-Allowed-Origin": origin, "WebHook-Allowed-Rate": "*"}
