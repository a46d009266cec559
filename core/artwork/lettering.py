"""The outlines of one watermark: text, logo or QR code, or a text beside one of the others."""

from core.artwork.artwork import Artwork
from core.artwork.combine import beside
from core.artwork.layouts import Layouts, distinct_layouts
from core.artwork.line import has_upright
from core.artwork.line_breaks import line_breaks
from core.artwork.outline import text_artwork
from core.artwork.qr import qr_artwork
from core.artwork.qr_code import check_code, round_up
from core.artwork.style import style_of
from core.choices import Direction, LogoPosition, Wrap
from core.errors import ErrorCode, MeshmarkError
from core.geometry.surface import MODEL_SIZE
from core.parameters import Parameters


def layouts_of(parameters: Parameters, font: bytes | None = None, logo: bytes | None = None) -> Layouts:
    """The layouts of a watermark, those left out in which its QR code could not be read.

    Args:
        parameters: of the request.
        font: a TrueType or OpenType file, if one was sent.
        logo: an SVG file, if there is a logo.

    Raises:
        MeshmarkError: ``empty_text``, ``invalid_parameters``, ``invalid_logo``, and as :func:`text_artwork`.
    """
    parameters.require_content(logo is not None)
    check_code(parameters)
    texts = _texts(parameters, font) if parameters.text.strip() else []
    if logo is not None:
        from core.artwork.svg import logo_artwork

        picture = logo_artwork(logo)
    elif parameters.qr is not None:
        picture = qr_artwork(parameters.qr)
    else:
        return distinct_layouts(texts)
    marks = [beside(picture, text, parameters.logo_position) for text in texts] or [picture]
    return distinct_layouts(_readable(marks, parameters))


def _texts(parameters: Parameters, font: bytes | None) -> list[Artwork]:
    """The text in each way of setting it, rows before columns."""
    texts = [parameters.text]
    if parameters.wrap is Wrap.AUTO:
        texts = ["\n".join(lines) for lines in line_breaks(parameters.text)]
    directions = [parameters.direction]
    if parameters.direction is Direction.AUTO:
        directions = [Direction.HORIZONTAL, *([Direction.VERTICAL] if has_upright(parameters.text) else [])]
    return [text_artwork(text, font, style_of(parameters, direction)) for direction in directions for text in texts]


def _readable(marks: list[Artwork], parameters: Parameters) -> list[Artwork]:
    """Those of the ``marks`` whose QR code, where they have one, can be read in the size that is asked for, or in that
    of the whole asset.

    Raises:
        MeshmarkError: ``invalid_parameters`` where there is none.
    """
    size = parameters.size
    most = MODEL_SIZE if size is None else size
    if readable := [mark for mark in marks if round(mark.least_width, 6) <= most]:
        return readable
    least = round_up(min(mark.least_width for mark in marks))
    remedy = f"Ask for a `size` of {least:g} or more" if least <= MODEL_SIZE else "Use a shorter text"
    if parameters.logo_position is LogoPosition.LEFT:
        remedy += ", put the code above the text (`logo_position`)"
    raise MeshmarkError(
        ErrorCode.INVALID_PARAMETERS,
        f"The QR code of `qr` takes so little of a mark with this `text` that its modules are too small to be read, in "
        f"{'a mark as wide as the asset' if size is None else f'a `size` of {size:g}'}.",
        f"{remedy}, or use a shorter address.",
    )
