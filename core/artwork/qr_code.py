"""The modules of a QR code (ISO/IEC 18004), and whether they can be read from a mark."""

import segno
from segno.encoder import DataOverflowError

from core.errors import ErrorCode, MeshmarkError

# 41 modules a side, 106 bytes at level M. A code of more modules is not read from a picture of a whole asset.
MAX_VERSION = 6
QUIET_ZONE = 4  # modules, by the standard
FRAME = 1  # modules; without it, other relief could come into the quiet zone
# Least module, where the asset's largest side is 30: two pixels of a picture of the whole asset, 1024 pixels wide.
MIN_MODULE = 0.06


def qr_modules(content: str, size: float | None = None) -> list[list[bool]]:
    """The rows of a code of level M, from the top down; dark modules are true.

    Args:
        content: to be encoded.
        size: width of the mark where the asset's largest side is 30, if that is given.

    Raises:
        MeshmarkError: ``invalid_parameters`` where the content is too long to be read.
    """
    try:
        code = segno.make(content, error="M", micro=False, boost_error=False)
    except DataOverflowError:
        raise _too_long(content) from None
    if int(code.version) > MAX_VERSION:
        raise _too_long(content)
    rows = [[bool(module) for module in row] for row in code.matrix]
    side = len(rows) + 2 * (QUIET_ZONE + FRAME)
    if size is not None and size < MIN_MODULE * side:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            f"The QR code of `qr` is {side} modules wide with its frame; in a `size` of {size:g} they are too small to "
            "be read.",
            f"Ask for a `size` of {MIN_MODULE * side:.3g} or more, leave it out, or use a shorter address.",
        )
    return rows


def _too_long(content: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.INVALID_PARAMETERS,
        f"The {len(content)} characters of `qr` make a QR code of more than version {MAX_VERSION}, too fine to be "
        "read from a mark.",
        "Use a shorter address: 106 bytes at most.",
    )
