"""Letting a sender of CloudEvents send (CloudEvents, "HTTP 1.1 Web Hooks for Event Delivery" 1.0, section 4).

A sender asks before it sends, so that it cannot be made to flood somebody who expects nothing. This is no proof of
who sends: see :mod:`service.hooks.guard`.
"""

from collections.abc import Mapping

from service.errors import ServiceErrorCode
from service.hooks.config import HookSource
from service.problems import ProblemError


def grant(source: HookSource, headers: Mapping[str, str]) -> dict[str, str]:
    """The headers that let the asking sender send, at whatever rate.

    Raises:
        ProblemError: ``method_not_allowed``, the source is not configured to be sent to by it, or nobody asks.
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
