"""Isolated Parts Error (paper, supplement "Asset Utility")."""

from core.geometry.surface import Surface
from core.metrics.topology import topology


def ipe(original: Surface, watermarked: Surface) -> int:
    """By how many connected parts the watermarked asset differs from the original; lower is better, 0 is best.

    Parts are groups of faces connected through shared edges of the exact-position weld. The paper counts with
    trimesh's ``split``, which also goes by shared edges; unlike there, edges of three and more faces connect too.
    """
    return abs(topology(watermarked).components - topology(original).components)
