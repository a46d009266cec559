"""All watermarks of an asset: places are chosen, cut, chosen again where a cut is refused, and searched for again."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.analysis.contrast import Look
from core.arrays import Float
from core.artwork.advice import smaller, subject
from core.artwork.layouts import Layouts
from core.embossing.emboss import EMBOSS, EmbossOptions, Mark, emboss
from core.embossing.islands import Letters
from core.embossing.mesh import WorkingMesh
from core.embossing.other_side import hold_other_side
from core.embossing.patch import patches
from core.embossing.refusal import CHEAP, EXPLAINED, Refusal
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.geometry.products import product
from core.geometry.spatial import SpatialIndex
from core.parameters import Parameters
from core.placement.context import PlacementContext
from core.placement.objective import Placement
from core.placement.place import search_again
from core.placement.selection import select

ALONG = np.linspace(0, 1, 9)  # parameters of the sample points on an edge


@dataclass(frozen=True)
class MarkOptions:
    """Values of :func:`emboss_marks`: all ours; the paper cuts its boxes once.

    Attributes:
        failed_cuts: refused cuts a requested mark, at most: cuts are the costly step, and further boxes are no better.
        max_searches: for more boxes.
        accepted_share: of the target objective; a search follows where refused cuts leave less.
        min_improvement: share of the target objective that a search has to recover for another to follow.
        doubts: refused doubtful boxes a requested mark, after which the other doubtful ones are not tried.
        same_side: cosine between the normals of boxes, from which on the same edges obstruct both.
        emboss: of each cut.
    """

    failed_cuts: int = 10
    max_searches: int = 4
    accepted_share: float = 0.9
    min_improvement: float = 0.02
    doubts: int = 4
    same_side: float = 0.8
    emboss: EmbossOptions = EMBOSS


MARKS = MarkOptions()


@dataclass(frozen=True, eq=False)
class Marks:
    """Embossed marks of an asset.

    Attributes:
        placement: the candidate boxes, those of later searches included.
        marks: each watermark by the number of its box in ``placement``.
        refusals: reasons of refused boxes, by their numbers in ``placement``.
    """

    placement: Placement
    marks: dict[int, Mark]
    refusals: dict[int, Refusal]


def emboss_boxes(
    mesh: WorkingMesh,
    boxes: Boxes,
    looks: Sequence[Look],
    letters: Letters,
    parameters: Parameters,
    index: SpatialIndex,
    options: EmbossOptions = EMBOSS,
) -> Iterator[Mark | Refusal]:
    """Embosses ``letters`` at each of the ``boxes`` in turn and yields each outcome.

    Args:
        mesh: changed by each watermark that succeeds.
        boxes: their widths are the texts' widths; size-30 frame.
        looks: of the letters at each.
        letters: in each layout.
        parameters: relief and mode.
        index: of the mesh's original surface.
        options: tuned values.
    """
    for number in range(len(boxes)):
        box = boxes[np.array([number])]
        relief = parameters.relief_at(float(letters.layouts.line_height(box.size)[0]))
        outcome = emboss(mesh, box, letters.of(box, looks[number]), relief, index, options)
        yield replace(outcome, look=looks[number]) if isinstance(outcome, Mark) else outcome


def emboss_marks(
    mesh: WorkingMesh,
    context: PlacementContext,
    placement: Placement,
    letters: Letters,
    rng: np.random.Generator,
    progress: Callable[[float], None] = lambda _: None,
    options: MarkOptions = MARKS,
) -> Marks:
    """Embosses the best choice of boxes.

    Where one is refused, the choice is made again among those not tried yet, and of these first among boxes without
    an edge that was in a refused one, and without the other side of a thin wall in their bounds. When these are used
    up, more are searched for in directions without coverage, while much of the target objective is missing and each
    search recovers some of it.

    Args:
        mesh: the asset, changed in place.
        context: the inputs of the search that found ``placement``, and of further ones.
        placement: the boxes to choose from.
        letters: in each layout.
        rng: the source of the searches' draws.
        progress: called with the share done, 0 to 1.
        options: tuned values.

    Raises:
        MeshmarkError: ``no_placement`` where every cut was refused.
    """
    count = context.parameters.count
    assert count is not None
    marks: dict[int, Mark] = {}
    refusals: dict[int, Refusal] = {}
    obstacles: list[tuple[Float, Float]] = []
    cuts_left = options.failed_cuts * count
    hoped, last = placement.value(placement.start), -np.inf
    enough, worthwhile = hoped - (1 - options.accepted_share) * abs(hoped), options.min_improvement * abs(hoped)
    for searches in range(options.max_searches + 1):
        chosen = list(placement.start)
        doubtful = set(np.flatnonzero(hold_other_side(placement.boxes, context)).tolist())
        doubtful |= {box for each in obstacles for box in _over(placement.boxes, each, options.same_side)}
        doubtful -= marks.keys()
        doubting, doubts_left = False, options.doubts * count
        while cuts_left > 0:
            avoided = refusals.keys() | doubtful
            chosen = select(placement, count, list(marks), avoided, chosen, context.options.selection)
            fresh = np.array([box for box in chosen if box not in marks], dtype=np.int64)
            if not len(fresh):
                if not doubtful or doubts_left <= 0 or placement.value(list(marks)) >= hoped - worthwhile:
                    break
                doubtful.clear()
                doubting = True
                continue
            boxes, index = placement.boxes[fresh], context.carrier.index
            looks = letters.looks(boxes)
            outcomes = emboss_boxes(mesh, boxes, looks, letters, context.parameters, index, options.emboss)
            for box, outcome in zip(fresh.tolist(), outcomes, strict=True):
                if isinstance(outcome, Mark):
                    marks[box] = outcome
                else:
                    refusals[box] = outcome
                    obstacles.append(_obstacles(mesh, placement.boxes[np.array([box])]))
                    doubtful |= _over(placement.boxes, obstacles[-1], options.same_side) - marks.keys()
                    doubts_left -= doubting
                    cuts_left -= outcome not in CHEAP
                progress(len(marks) / count)
        value = placement.value(list(marks))
        done = value >= enough or value - last <= worthwhile or searches == options.max_searches
        if not refusals or cuts_left <= 0 or done:
            break
        last = value
        placement = search_again(context, placement, list(marks), refusals.keys() | doubtful, rng)
    if not marks:
        raise nothing_embossed(refusals, context.layouts, context.parameters)
    return Marks(placement, marks, refusals)


def _obstacles(mesh: WorkingMesh, box: Boxes) -> tuple[Float, Float]:
    """Possible obstacles to embossing the one ``box``: (K, 3) points on boundary edges of patches in it, and its own
    centre, size-30 units; and (3,) its normal."""
    found = [box.center]
    for patch in patches(mesh, box) or []:
        start, end = patch.points[patch.boundary].transpose(1, 0, 2)
        points = (start[:, None] + ALONG[:, None] * (end - start)[:, None]).reshape(-1, 3) * box.size[0, 0]
        under = points[(np.abs(points) <= box.size[0] / 2).all(axis=1)]
        found.append(box.center + product(under, box.axes[0]))
    return np.concatenate(found), box.axes[0, 2]


def _over(boxes: Boxes, obstacles: tuple[Float, Float], same_side: float) -> set[int]:
    """The boxes that contain any of the ``obstacles`` (see :func:`_obstacles`), on the side of their normal: letters
    hardly fit there."""
    points, normal = obstacles
    beside = np.flatnonzero(product(boxes.axes[:, 2], normal[:, None])[:, 0] > same_side)
    local = np.einsum("bki,bji->bkj", points - boxes.center[beside, None], boxes.axes[beside])
    inside = (np.abs(local) <= boxes.size[beside, None] / 2).all(axis=2).any(axis=1)
    return set(beside[inside].tolist())


def nothing_embossed(refusals: dict[int, Refusal], layouts: Layouts, asked: Parameters) -> MeshmarkError:
    """The error that a text in these ``layouts`` was refused at every place, most often for one reason."""
    worst, times = Counter(refusals.values()).most_common(1)[0]
    reason, remedy = EXPLAINED[worst]
    tried = len(refusals)
    width = asked.size if asked.size_exact else None
    return MeshmarkError(
        ErrorCode.NO_PLACEMENT,
        f"The {subject(layouts)} could not be cut into any of the {tried} places found, "
        f"{'' if times == tried else f'most of them ({times}) '}because {reason}.",
        remedy.format(smaller=smaller(layouts, width)),
    )
