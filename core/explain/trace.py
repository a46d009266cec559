"""A watch on a search for places that keeps all boxes by stage."""

from dataclasses import fields

import numpy as np

from core.geometry.boxes import Boxes
from core.placement.cost import Terms
from core.placement.rejection import Stage


class Trace:
    """The boxes of every search, and the cost terms of those that passed all stages.

    Attributes:
        searches: by stage, the boxes that it left; one entry for each width of a layout that was tried, and for each
            time that chosen boxes were moved or widened, which has no candidates.
    """

    def __init__(self) -> None:
        self.searches: list[dict[Stage, Boxes]] = []
        self._terms: dict[bytes, dict[str, float]] = {}

    def passed(self, stage: Stage, boxes: Boxes) -> None:
        """Keep the boxes that a stage left."""
        begins = stage is Stage.CANDIDATES or (stage is Stage.ALIGNED and self._last_is_past(stage))
        if begins:
            self.searches.append({})
        self.searches[-1][stage] = boxes

    def valued(self, boxes: Boxes, terms: Terms) -> None:
        """Keep the terms of each box."""
        columns = {field.name: np.asarray(getattr(terms, field.name), dtype=np.float64) for field in fields(Terms)}
        for number, name in enumerate(_names(boxes)):
            self._terms[name] = {term: float(column[number]) for term, column in columns.items()}

    def _last_is_past(self, stage: Stage) -> bool:
        return not self.searches or stage in self.searches[-1]

    def left(self, stage: Stage) -> Boxes:
        """All boxes that a stage left, in whichever search."""
        return Boxes.concat(Boxes.empty(), *(search[stage] for search in self.searches if stage in search))

    def dropped(self, stage: Stage) -> Boxes:
        """The boxes that a stage dropped; none for fitting, which moves them, and for what comes before.

        Of copies of each other, one is no loss: these are not told either.
        """
        order = list(Stage)
        if order.index(stage) <= order.index(Stage.DISTINCT):
            return Boxes.empty()
        before = order[order.index(stage) - 1]
        parts = [Boxes.empty()]
        for search in self.searches:
            if stage in search:
                kept = set(_names(search[stage]))
                gone = [number for number, name in enumerate(_names(search[before])) if name not in kept]
                parts.append(search[before][np.array(gone, dtype=np.int64)])
        return Boxes.concat(*parts)

    def terms(self, boxes: Boxes) -> Terms:
        """The cost terms of some boxes that passed all stages."""
        rows = [self._terms[name] for name in _names(boxes)]
        return Terms(**{field.name: np.array([row[field.name] for row in rows]) for field in fields(Terms)})


def _names(boxes: Boxes) -> list[bytes]:
    """The boxes' own bytes: filters drop boxes, and move none."""
    rows = np.hstack([boxes.center, boxes.axes.reshape(-1, 9), boxes.size]).astype(np.float64)
    return [row.tobytes() for row in rows]
