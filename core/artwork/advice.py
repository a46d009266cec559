"""Words of messages about a mark, which depend on whether it is a text, a logo or a QR code."""

from core.artwork.artwork import Logo
from core.artwork.layouts import Layouts
from core.artwork.qr_code import round_up
from core.parameters import MIN_SIZE

_SUBJECT: dict[tuple[Logo | None, bool], str] = {
    (None, True): "text",
    ("svg", False): "logo",
    ("svg", True): "logo with the text",
    ("qr", False): "QR code",
    ("qr", True): "QR code with the text",
}
_PLAINER: dict[tuple[Logo | None, bool], str] = {
    (None, True): "a shorter text",
    ("svg", False): "a simpler logo",
    ("svg", True): "a shorter text or a simpler logo",
    ("qr", False): "a shorter address",
    ("qr", True): "a shorter text or address",
}


def subject(layouts: Layouts) -> str:
    """The name of the mark."""
    return _SUBJECT[layouts.logo, bool(layouts.artworks[0].label)]


def plainer(layouts: Layouts) -> str:
    """The kind of mark that needs less room."""
    return _PLAINER[layouts.logo, bool(layouts.artworks[0].label)]


def smaller(layouts: Layouts, width: float | None = None) -> str:
    """The remedy where there was no room for marks, the narrowest of which were of a ``width``, if that is known.

    No ``size`` is advised that would be refused: below the least of all, or in which a QR code cannot be read.
    """
    readable = min(artwork.least_width for artwork in layouts.artworks)
    least = round_up(max(readable, MIN_SIZE))
    if width is not None and width <= least:
        return f"Use {plainer(layouts)}."
    size = "a smaller `size`" if width is None else f"a `size` below {width:.3g}"
    return f"Ask for {size}{f', of {least:g} or more' if readable else ''}, or use {plainer(layouts)}."
