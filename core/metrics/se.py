"""Saliency Error (paper, Definition 4 and supplement "Asset Utility")."""

from core.analysis.saliency import Saliency
from core.arrays import Float
from core.geometry.boxes import Boxes

VOTE = 0.5  # mean of the thresholded saliency above which a box votes (the paper's)


def se(saliency: Saliency, boxes: Boxes) -> tuple[float, Float]:
    """Share of marks on salient parts of the original, 0 to 1; lower is better, 0 is best.

    A box votes 1 if the mean of the thresholded saliency within it is greater than 0.5, that is if more than half of
    the surface inside it is salient, and 0 otherwise; the result is the mean vote. For the surface inside a box, also
    one too small for any sample, see :meth:`core.analysis.saliency.Saliency.under`. The vote is the paper's, the maps
    are not: neither our own (:func:`core.analysis.saliency.saliency`, with the differences) nor the published one
    (:func:`core.metrics.mesh_saliency.mesh_saliency`); the paper's figures are not comparable with these.

    Args:
        saliency: of the original surface.
        boxes: the marks; where there are none, none is on a salient part.

    Returns:
        The error, and the mean saliency (B,), 0 to 1, of the surface inside each box.
    """
    mean, share = saliency.under(saliency.pairs_in_boxes(boxes))
    return float((share > VOTE).sum() / max(len(boxes), 1)), mean
