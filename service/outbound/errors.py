"""The two ways an outbound request ends without an answer."""

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode


class Unreachable(Exception):  # noqa: N818  (a state of the other side, not a fault of this one)
    """The address may be asked, but gave no answer. The message is a clause such as "it refused the connection"."""


def address_refused(
    reason: str, remedy: str = "Give the https address of a server on the public internet."
) -> MeshmarkError:
    """The error for an address that is not asked at all."""
    return MeshmarkError(ServiceErrorCode.ADDRESS_REFUSED, reason, remedy)
