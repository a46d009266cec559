"""Isolated Parts Error (paper, supplement "Asset Utility")."""

from core.geometry.surface import Surface
from core.metrics.topology import topology


def ipe(original: Surface, watermarked: Surface) -> int:
    """Difference in the number of connected components of the watermarked asset and the original; lower is better, 0
    is best.

    Components are groups of faces connected through shared edges of the exact-position weld. The paper counts with
    trimesh's ``split``, which also goes by shared edges; unlike there, edges of three and more faces connect too.
    """
    return abs(topology(watermarked).components - topology(original).components)
