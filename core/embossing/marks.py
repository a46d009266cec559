"""All watermarks of an asset: places are chosen, cut, chosen again where a cut is refused, and searched for again."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from core.embossing.emboss import Mark, emboss
from core.embossing.mesh import WorkingMesh
from core.embossing.refusal import CHEAP, Refusal
from core.embossing.stamp import Stamp
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters
from core.placement.boxes import Boxes
from core.placement.objective import Placement
from core.placement.place import place_more
from core.placement.selection import select
from core.placement.site import Site
from core.spatial import SpatialIndex

FAILED_CUTS = 10  # for each mark that is asked for: a cut is the costly part; after so many the rest is no better
MAX_SEARCHES = 4
# Of what the marks were to be worth. Where refused cuts leave less than the first, places are searched for again, and
# once more while the last search regained the second.
REGAINED, WORTHWHILE = 0.9, 0.02


@dataclass(frozen=True, eq=False)
class Marks:
    """What was embossed.

    Attributes:
        placement: the boxes there were to choose from, those of later searches included.
        marks: each watermark by the number of its box in ``placement``.
        refusals: how many boxes were refused, by reason.
    """

    placement: Placement
    marks: dict[int, Mark]
    refusals: Counter[str]


def emboss_boxes(
    mesh: WorkingMesh, boxes: Boxes, letters: Stamp, parameters: Parameters, index: SpatialIndex
) -> Iterator[Mark | Refusal]:
    """Embosses ``letters`` at each of the ``boxes`` in turn and says what came of it.

    Args:
        mesh: changed by each watermark that succeeds.
        boxes: their widths are the texts' widths; size-30 frame.
        letters: the islands in text widths.
        parameters: relief and mode.
        index: of the mesh's original surface.
    """
    for number in range(len(boxes)):
        box = boxes[np.array([number])]
        yield emboss(mesh, box, letters, parameters.relief_at(box.size[0, 1]), index)


def emboss_marks(
    mesh: WorkingMesh,
    site: Site,
    placement: Placement,
    letters: Stamp,
    rng: np.random.Generator,
    progress: Callable[[float], None] = lambda _: None,
) -> Marks:
    """Embosses the best choice of boxes.

    Where one is refused, the choice is made again among those not tried yet. When these are used up, more are searched
    for where nothing is seen, while much of what the marks were to be worth is missing and each search regains some of
    it.

    Args:
        mesh: the asset, changed in place.
        site: where ``placement`` was found, and where more is searched for.
        placement: the boxes to choose from.
        letters: the islands in text widths.
        rng: the source of the searches' draws.
        progress: called with the share done, 0 to 1.

    Raises:
        MeshmarkError: ``no_placement`` where every cut was refused.
    """
    count = site.parameters.count
    assert count is not None
    marks: dict[int, Mark] = {}
    refusals: Counter[str] = Counter()
    dead: set[int] = set()
    cuts_left = FAILED_CUTS * count
    hoped, last = placement.value(placement.start), -np.inf
    enough, worthwhile = hoped - (1 - REGAINED) * abs(hoped), WORTHWHILE * abs(hoped)
    for searches in range(MAX_SEARCHES + 1):
        chosen = list(placement.start)
        while cuts_left > 0:
            chosen = select(placement, count, fixed=list(marks), dead=dead, start=chosen)
            fresh = np.array([box for box in chosen if box not in marks], dtype=np.int64)
            if not len(fresh):
                break
            outcomes = emboss_boxes(mesh, placement.boxes[fresh], letters, site.parameters, site.index)
            for box, outcome in zip(fresh.tolist(), outcomes, strict=True):
                if isinstance(outcome, Mark):
                    marks[box] = outcome
                else:
                    refusals[outcome.value] += 1
                    dead.add(box)
                    cuts_left -= outcome not in CHEAP
                progress(len(marks) / count)
        value = placement.value(list(marks))
        if not dead or cuts_left <= 0 or value >= enough or value - last <= worthwhile or searches == MAX_SEARCHES:
            break
        last = value
        placement = place_more(site, placement, list(marks), dead, rng)
    if not marks:
        raise _nothing_embossed(refusals)
    return Marks(placement, marks, refusals)


def _nothing_embossed(refusals: Counter[str]) -> MeshmarkError:
    reasons = ", ".join(f"{count} {reason}" for reason, count in refusals.most_common())
    coarse = refusals.most_common(1)[0][0] == Refusal.TOO_FINE
    return MeshmarkError(
        ErrorCode.NO_PLACEMENT,
        f"The text could not be cut whole into any of the {refusals.total()} places found ({reasons})."
        + (" The file's 32-bit coordinates are too coarse for letters this far from the origin." * coarse),
        "Move the model to the origin of its own coordinates."
        if coarse
        else "Ask for a smaller `size` or `relief`, or use a shorter text.",
    )
