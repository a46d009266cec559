"""What can be refused at once, without loading the asset."""

from pathlib import Path
from threading import Lock

from core.asset.budgets import Budgets
from core.asset.gate import admit
from core.errors import MeshmarkError
from core.lettering.fonts import default_font, load_font
from core.lettering.shaping import shape
from core.parameters import Parameters

# Bounds what uploads hold in memory to one asset, of which the gate may make one copy. It takes two seconds at most.
_IN_MEMORY = Lock()


def check_lettering(parameters: Parameters, font: bytes | None) -> None:
    """Refuse a text that the font cannot write.

    Raises:
        MeshmarkError: ``invalid_font``, ``missing_glyphs``, ``empty_text``, ``invalid_parameters``.
    """
    shape(parameters.text, default_font() if font is None else load_font(font))


def check_asset(path: Path, budgets: Budgets) -> None:
    """Refuse an asset whose header already tells that it cannot be watermarked.

    Raises:
        MeshmarkError: as :func:`core.asset.gate.admit` does.
    """
    with _IN_MEMORY:
        refusal = _refusal(path, budgets)
    if refusal:
        raise refusal


def _refusal(path: Path, budgets: Budgets) -> MeshmarkError | None:
    """What the gate raises, as a new error: the frames in a traceback would hold the asset until the answer is sent."""
    try:
        admit(path.read_bytes(), budgets)
    except MeshmarkError as error:
        return MeshmarkError(error.code, error.message, error.remedy)
    return None
