"""Visible marks of a suspect file: looked for from all sides, then looked at head-on and from near by."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from core.arrays import Float
from core.geometry.directions import view_directions
from core.gltf.scene import Scene
from core.metrics.recognition import Reader
from core.rendering.renderer import Frame, Renderer
from core.verify.look import Look, Picture, look
from core.verify.places import Place, places
from core.verify.readings import Reading, Spot, readings
from core.verify.report import Kind
from core.verify.texts import best, enough, fewest_letters, likeness

PICTURE, SHOWN = 1024, 512  # pixels a side of pictures that are read, and of those that are kept
KINDS: tuple[Kind, ...] = ("ordinary", "relief")  # of pictures of all of an asset
NEAR_KINDS: tuple[Kind, ...] = (*KINDS, "height")  # from nearer
SIDES = np.array([[0.0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
HEADS = np.array([[0.0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]])
OFF, PART = 0.42, 0.55  # of a part of a side from its middle, and its radius, over the radius of the whole
HINT = 0.4  # likeness to a known text from which on a place is looked at again
SURE = 0.6  # confidence of readings from which on a place without a known text is
SHORTEST = 3  # letters of such a reading
MOST_PLACES = 24  # that are looked at again
GRAIN = 3.0  # pixels; letters of a second look are some hundred high
NEARER, LEAST_RADIUS = 0.75, 0.5  # radius of a second look over the length of the writing; size-30 units, at least
# Of two places: the cosine between their normals, and the shares of the larger one's length and height that lie between
# them, from which on they are not the same writing.
FACING, BESIDE, BELOW = 0.5, 0.7, 0.9
HERE, OPPOSITE = 0.25, -0.2  # nearer ones, by the larger one's length, are, unless their normals are opposite
SETTLED = 3  # pictures that read a known text exactly, from which on no nearer one is read
VOTES = 2  # pictures that have to read a text, unless one reads it exactly


@dataclass(frozen=True, eq=False)
class FoundMark:
    """Writing that was found on an asset.

    Attributes:
        text: as it was read best.
        known: the known text that it is; None where it is none.
        likeness: to that, or to the most like of the known texts, 0 to 1.
        confidence: of the recogniser, 0 to 1.
        votes: pictures that read so.
        kinds: of the pictures that read it.
        spot: on the surface, size-30 units.
        picture: (S, S, 3) of a look at it head-on.
    """

    text: str
    known: str | None
    likeness: float
    confidence: float
    votes: int
    kinds: tuple[Kind, ...]
    spot: Spot
    picture: NDArray[np.uint8]


def find_marks(scene: Scene, texts: Sequence[str], renderer: Renderer, reader: Reader) -> list[FoundMark]:
    """Marks on an asset, the surest first.

    Ordinary and relief pictures of the paper's 24 views are read; where these show no mark, four parts of each of the
    six sides from nearer. Places where something like one of the ``texts`` is
    read, or without any, where anything is read with confidence, are looked at again, head-on and so near that the
    writing fills the picture. A text counts as found where enough of these pictures agree; without known texts
    everything that is read with confidence does.

    Args:
        scene: of the suspect file.
        texts: known ones.
        renderer, reader: made once for many calls.

    Raises:
        MeshmarkError: as :meth:`core.rendering.renderer.Renderer.load`.
    """
    renderer.load(scene)
    whole = renderer.frame
    letters = fewest_letters(texts) if texts else SHORTEST
    from_all_sides = readings(_from_all_sides(renderer), KINDS, reader, letters)
    return _marks(from_all_sides, texts, letters, renderer, reader) or _marks(
        readings(_in_parts(renderer, whole), NEAR_KINDS, reader, letters), texts, letters, renderer, reader
    )


def _from_all_sides(renderer: Renderer) -> Iterator[Look]:
    """Looks at all of an asset."""
    for camera in np.unique(np.hstack(view_directions()), axis=0):
        yield look(renderer, camera[:3], camera[3:])


def _in_parts(renderer: Renderer, whole: Frame) -> Iterator[Look]:
    """Looks at four parts of each of its six sides, from half the distance: for marks that are small on it."""
    center, reach = np.array(whole.center), OFF * whole.radius
    for direction, up in zip(SIDES, HEADS, strict=True):
        right = np.cross(up, direction)
        for across, along in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            x, y, z = (center + reach * (across * right + along * up)).tolist()
            renderer.aim(Frame((x, y, z), PART * whole.radius))
            yield look(renderer, direction, up)


def _marks(
    every: list[Reading], texts: Sequence[str], letters: int, renderer: Renderer, reader: Reader
) -> list[FoundMark]:
    """The marks at the places where something of so many letters or more was read, the surest first."""
    found = places(every)
    asked = sorted((place for place in found if _promise(place, texts)), key=lambda place: -_promise(place, texts))
    marks = [
        _again(place, -number, texts, letters, renderer, reader) for number, place in enumerate(asked[:MOST_PLACES], 1)
    ]
    chosen = [mark for mark in marks if mark is not None]
    return _distinct(sorted(chosen, key=lambda mark: (-mark.likeness, -mark.votes, -mark.confidence)))


def _promise(place: Place, texts: Sequence[str]) -> float:
    """Promise of a place for a second look; 0 for none."""
    if texts:
        likeness = max(best(texts, one.text)[0] for one in place.readings)
        return likeness if likeness >= HINT else 0.0
    sure = [one.confidence for one in place.readings if one.confidence >= SURE and len(one.text) >= SHORTEST]
    return max(sure, default=0.0)


def _again(
    place: Place, number: int, texts: Sequence[str], letters: int, renderer: Renderer, reader: Reader
) -> FoundMark | None:
    """The mark at a place, by all pictures of it; None where too few agree."""
    spot = place.spot
    x, y, z = spot.center.tolist()
    renderer.aim(Frame((x, y, z), max(NEARER * spot.length, LEAST_RADIUS)))
    near = look(renderer, spot.normal, spot.up, GRAIN)
    lines = [] if _settled(place, texts) else readings([near], NEAR_KINDS, reader, letters, number)
    every = [*place.readings, *lines, *_passages(lines)]
    vote = _vote_for(texts, every) if texts else _vote(every)
    if vote is None:
        return None
    reading, pictures = vote.reading, vote.pictures
    return FoundMark(
        text=reading.text,
        known=vote.known,
        likeness=vote.likeness,
        confidence=reading.confidence,
        votes=len(pictures),
        kinds=tuple(sorted({kind for _, kind in pictures})),
        spot=reading.spot,
        picture=_shown(near, reading),
    )


def _shown(near: Look, reading: Reading) -> Picture:
    """The picture of a look at a place as it is shown to people, what was read there upright: (SHOWN, SHOWN, 3)."""
    is_upright = float(reading.spot.right @ near.axes[0]) >= 0
    picture = np.rot90(near.picture(reading.kind), 0 if is_upright else 2)
    return np.asarray(cv2.resize(picture, (SHOWN, SHOWN), interpolation=cv2.INTER_AREA), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class _Vote:
    """Outcome of a vote: the best reading, the known text that it is, and the pictures that read it."""

    reading: Reading
    known: str | None
    likeness: float
    pictures: set[tuple[int, Kind]]


def _vote_for(texts: Sequence[str], every: Sequence[Reading]) -> _Vote | None:
    """The vote of all readings of a place for one of some known texts."""
    scored = [(*best(texts, one.text), one) for one in every]
    agreeing = [(ratio, text, one) for ratio, text, one in scored if text is not None and ratio >= enough(text)]
    if not agreeing:
        return None
    ratio, known, reading = max(agreeing, key=lambda found: (found[0], found[2].confidence))
    pictures = {(one.look, one.kind) for _, text, one in agreeing if text == known}
    return _Vote(reading, known, ratio, pictures) if ratio == 1 or len(pictures) >= VOTES else None


def _vote(every: Sequence[Reading]) -> _Vote | None:
    """The vote of all readings of a place for what most of them say."""
    sure = [one for one in every if one.confidence >= SURE and len(one.text) >= SHORTEST]
    reading = max(sure, key=lambda one: (_weight(one, sure), one.confidence))
    alike = [one for one in sure if likeness(reading.text, one.text) >= enough(reading.text)]
    pictures = {(one.look, one.kind) for one in alike}
    return _Vote(reading, None, 0.0, pictures) if len(pictures) >= VOTES else None


def _weight(reading: Reading, every: Sequence[Reading]) -> float:
    """Confidence of all readings that say the same, times their length: a part of the text is read more often."""
    return len(reading.text) * sum(one.confidence for one in every if likeness(one.text, reading.text) == 1)


def _settled(place: Place, texts: Sequence[str]) -> bool:
    """True where enough pictures read a known text exactly: a nearer one is for people to look at only."""
    return len({(one.look, one.kind) for one in place.readings if best(texts, one.text)[0] == 1}) >= SETTLED


def _passages(lines: list[Reading]) -> list[Reading]:
    """The lines of each near picture joined from the top down: texts of several lines."""
    joined = []
    for kind in NEAR_KINDS:
        mine = sorted(
            (one for one in lines if one.kind == kind and one.confidence >= SURE), key=lambda one: one.spot.row
        )
        upright = [one for one in mine if one.spot.right @ mine[0].spot.right > 0]
        if len(upright) > 1:
            text = " ".join(one.text for one in upright)
            joined.append(replace(upright[0], text=text, confidence=min(one.confidence for one in upright)))
    return joined


def _distinct(marks: list[FoundMark]) -> list[FoundMark]:
    """The marks without those that lie where a surer one does."""
    kept: list[FoundMark] = []
    for mark in marks:
        if all(_apart(mark.spot, other.spot) for other in kept):
            kept.append(mark)
    return kept


def _apart(one: Spot, other: Spot) -> bool:
    """True where two places cannot be the same writing, a part of which was read elsewhere in it."""
    away: Float = other.center - one.center
    along, across, out = (abs(float(away @ axis)) for axis in (one.right, one.up, one.normal))
    length, height = max(one.length, other.length), max(one.height, other.height)
    alike = float(one.normal @ other.normal)
    # Seen steeply the ground's direction is not known well; the other side of a wall looks the other way.
    if np.linalg.norm(away) < HERE * length and alike > OPPOSITE:
        return False
    return alike < FACING or along > BESIDE * length or across > BELOW * height or out > length / 2
