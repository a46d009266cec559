"""The modules of a QR code (ISO/IEC 18004), and whether they can be read from a mark."""

import math
from collections.abc import Sequence

import segno
from segno.encoder import DataOverflowError

from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters

# 41 modules a side, 106 bytes at level M. A code of more modules is not read from a picture of a whole asset.
MAX_VERSION = 6
QUIET_ZONE = 4  # modules, by the standard
FRAME = 1  # modules; without it, other relief could come into the quiet zone
# Least module, where the asset's largest side is 30: two pixels of a picture of the whole asset, 1024 pixels wide.
MIN_MODULE = 0.06


def qr_modules(content: str) -> list[list[bool]]:
    """The rows of a code of level M, from the top down; dark modules are true.

    Raises:
        MeshmarkError: ``invalid_parameters`` where the content is too long to be read.
    """
    try:
        code = segno.make(content, error="M", micro=False, boost_error=False)
    except DataOverflowError:
        raise _too_long(content) from None
    if int(code.version) > MAX_VERSION:
        raise _too_long(content)
    return [[bool(module) for module in row] for row in code.matrix]


def check_code(parameters: Parameters) -> None:
    """Refuse a QR code that cannot be read: too long an address, or modules too small in the size that is asked for.

    How much of the size a code beside a text has is not known before the text is drawn: see
    :func:`core.artwork.lettering.layouts_of`.

    Raises:
        MeshmarkError: ``invalid_parameters``.
    """
    if parameters.qr is None:
        return
    resolved, side = parameters.resolved(), side_of(qr_modules(parameters.qr))
    size = resolved.size
    if size is not None and size < round(MIN_MODULE * side, 6) and not resolved.text.strip():
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            f"The QR code of `qr` is {side} modules wide with its frame; in a `size` of {size:g} they are too small to "
            "be read.",
            f"Ask for a `size` of {round_up(MIN_MODULE * side):g} or more, or use a shorter address.",
        )


def side_of(modules: Sequence[Sequence[bool]]) -> int:
    """Modules along a side of a code, its quiet zone and its frame included."""
    return len(modules) + 2 * (QUIET_ZONE + FRAME)


def round_up(width: float) -> float:
    """A least width for people: in hundredths, none of which is below it."""
    return math.ceil(width * 100 - 1e-6) / 100


def _too_long(content: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.INVALID_PARAMETERS,
        f"The {len(content)} characters of `qr` make a QR code of more than version {MAX_VERSION}, too fine to be "
        "read from a mark.",
        "Use a shorter address: 106 bytes at most.",
    )
