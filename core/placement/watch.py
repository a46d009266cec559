"""Steps of a search for places, told to somebody who watches it, as :mod:`core.explain` does."""

from typing import Protocol

from core.geometry.boxes import Boxes
from core.placement.cost import Terms
from core.placement.rejection import Stage


class Watch(Protocol):
    """Somebody who is told of every box. Nothing that he does changes the search."""

    def passed(self, stage: Stage, boxes: Boxes) -> None:
        """Hear of the ``boxes`` of one width, or of some that were moved, that a stage left."""

    def valued(self, boxes: Boxes, terms: Terms) -> None:
        """Hear of the cost terms of the ``boxes`` that passed all stages."""


class Unwatched:
    """Nobody."""

    def passed(self, stage: Stage, boxes: Boxes) -> None:
        """Ignore them."""

    def valued(self, boxes: Boxes, terms: Terms) -> None:
        """Ignore them."""


UNWATCHED = Unwatched()
