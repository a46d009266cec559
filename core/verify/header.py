"""The header of a picture of a suspect file: its format and its size; nothing is decoded."""

from core.errors import ErrorCode, MeshmarkError
from core.gltf.images import image_size, mime_type

FORMATS = {"image/png": "png", "image/jpeg": "jpeg", "image/webp": "webp"}
MOST_PIXELS = 50_000_000


def picture_format(data: bytes) -> str | None:
    """The format of a picture; None for anything else."""
    return FORMATS.get(mime_type(data) or "")


def declared_size(data: bytes) -> tuple[int, int]:
    """(width, height) of a picture, pixels.

    Raises:
        MeshmarkError: ``budget_exceeded`` above 50 megapixels; ``malformed_file``.
    """
    size = image_size(memoryview(data))
    if size is None or min(size) < 1:
        raise malformed_picture("its header is broken")
    if size[0] * size[1] > MOST_PIXELS:
        raise MeshmarkError(
            ErrorCode.BUDGET_EXCEEDED,
            f"The picture has {size[0]:,} x {size[1]:,} pixels; at most {MOST_PIXELS:,} are read.",
            "Send a smaller picture.",
        )
    return size


def malformed_picture(what: str) -> MeshmarkError:
    """The error for a picture that cannot be decoded, and why."""
    return MeshmarkError(
        ErrorCode.MALFORMED_FILE, f"The picture cannot be decoded: {what}.", "Save it again as PNG or JPEG."
    )
