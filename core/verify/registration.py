"""Registration of a suspect surface to an original's: scale, rotation and translation."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import distance_transform_edt

from core.arrays import Float
from core.geometry.products import cross, product
from core.geometry.sampling import sample
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.geometry.triangles import unit


@dataclass(frozen=True)
class RegistrationOptions:
    """Values of :func:`registrations`: all ours.

    Attributes:
        many: points of each surface that fill a grid of distances.
        points: of these, the ones that alignments are chosen and refined by.
        few: of these, the ones that all rotations are tried with.
        seed: of the points.
        turns: rotations that are tried, spread evenly over all.
        refined: of these alignments, the best that are refined; and most that are given.
        apart: radians between the rotations of two of these, at least.
        steps, last_steps: of refining each, with some of the points, and the chosen ones with all.
        trim: share of the points, those nearest to the other surface, that an alignment is refined and measured by.
        growth: factor by which refining may change the scale: what shrinks enough fits anywhere.
        cap: of the original's radius, from which on a distance counts no more when alignments are compared.
        near: of the original's radius, within which a point of the original counts as covered.
        alike: of the original's radius, mean distance by which another alignment may be worse than the best and still
            be given: surfaces that are the same turned. World coordinates as they are may be twice as much worse.
        cells: of a side of the grid of distances, which reaches so many size-30 units from the middle.
        reach: that.
    """

    many: int = 16_000
    points: int = 2000
    few: int = 300
    seed: int = 0
    turns: int = 4000
    refined: int = 24
    apart: float = 0.35
    steps: int = 12
    last_steps: int = 30
    trim: float = 0.8
    growth: float = 1.5
    cap: float = 0.1
    near: float = 0.02
    alike: float = 0.002
    cells: int = 72
    reach: float = 24.0


BESIDE = 1e-6  # of the other side's radius; nearer ones lie on the surface, and point nowhere

REGISTRATION = RegistrationOptions()


@dataclass(frozen=True, eq=False)
class Similarity:
    """A map of points: ``scale * rotation @ point + translation``.

    Attributes:
        scale: above 0.
        rotation: (3, 3).
        translation: (3,).
    """

    scale: float
    rotation: Float
    translation: Float

    def __call__(self, points: Float) -> Float:
        """(N, 3) images of ``points`` (N, 3)."""
        return np.asarray(self.scale * product(points, self.rotation.T) + self.translation)

    def inverse(self) -> "Similarity":
        """The map back."""
        back = self.rotation.T
        return Similarity(1 / self.scale, back, -(back @ self.translation) / self.scale)

    def after(self, first: "Similarity") -> "Similarity":
        """This one applied to what ``first`` gives."""
        return Similarity(self.scale * first.scale, self.rotation @ first.rotation, self(first.translation[None])[0])


@dataclass(frozen=True, eq=False)
class Registration:
    """An alignment of a suspect surface with an original.

    Attributes:
        similarity: from the suspect's size-30 frame to the original's.
        residual: root mean square distance of the suspect's nearest four fifths to the original, over the
            radius of the suspect there.
        covered: share of the original's area that the suspect lies near.
    """

    similarity: Similarity
    residual: float
    covered: float


def registrations(
    suspect: Surface, original: Surface, options: RegistrationOptions = REGISTRATION
) -> list[Registration]:
    """Alignments of ``suspect`` with ``original``, the best first; others follow that are as good within measure, as a
    cube has many.

    World coordinates as they are come first; then rotations spread over all, about both middles, at the scale of both
    extents. The best of these are refined by trimmed iterations towards the closest points' planes, in all of scale,
    rotation and translation, and compared by distances both ways, so that a part of the original (a crop) fits, and
    what shrinks onto a spot of it does not.

    Args:
        suspect, original: each in its own size-30 frame.
        options: tuned values.

    Raises:
        MeshmarkError: ``no_faces`` where a surface has no area.
    """
    one, other = _Side(suspect, options), _Side(original, options)
    starts = [_identity(suspect, original), *_principal(suspect, original), *_turned(one, other, options)]
    last = [_identity(suspect, original), *_best(starts, one, other, options)]
    last, cost = _all_settled(last, one, other, options)
    # A corner that was cropped off a box fits it at many scales: what lies where it did before comes first.
    rank = np.argsort(np.where(np.arange(len(last)) == 0, cost - 2 * options.alike, cost), kind="stable")
    most = cost[rank[0]] + options.alike
    found = _distinct([last[number] for number in rank if cost[number] <= most], options)
    more, cost = _all_settled(_turned_onto_itself(found, options), one, other, options)
    found = _distinct([*found, *(each for each, worth in zip(more, cost, strict=True) if worth <= most)], options)
    return [_measured(each, one, other, options) for each in found]


def _all_settled(
    starts: list[Similarity], one: "_Side", other: "_Side", options: RegistrationOptions
) -> tuple[list[Similarity], Float]:
    settled = [_settled(start, one, other, options) for start in starts]
    return [found for found, _ in settled], np.array([cost for _, cost in settled])


def _turned_onto_itself(found: list[Similarity], options: RegistrationOptions) -> list[Similarity]:
    """Alignments that are missing among some of a shape that is the same turned: any two of them tell how it is
    turned onto itself, and so to go on from each other one."""
    turns = [each.after(found[0].inverse()) for each in found[1:]]
    return _distinct([*found, *(turn.after(each) for turn in turns for each in found)], options)[len(found) :]


def _best(starts: list[Similarity], one: "_Side", other: "_Side", options: RegistrationOptions) -> list[Similarity]:
    """Those of some alignments that few points fit best with, once refined."""
    few = options.few
    refined = [_refined(start, one.points[:few], other, options.steps, options) for start in starts]
    cost = np.array([_cost(*_both(found, one, other, few), options) for found in refined])
    rank = np.argsort(cost, kind="stable")
    return _distinct([refined[number] for number in rank if cost[number] <= cost.min() + 4 * options.alike], options)


def _settled(start: Similarity, one: "_Side", other: "_Side", options: RegistrationOptions) -> tuple[Similarity, float]:
    """An alignment refined by the nearest share of the suspect's points, and its cost.

    Where these lie on the original, all points of both refine it further, which counts where it fits better: only its
    rims hold a plate where it is, most of them are among the farthest points, and the suspect's alone let it shrink.
    """
    near = _refined(start, one.points, other, options.last_steps, options)
    there, back = _both(near, one, other, options.points)
    cost = _cost(there, back, options)
    if _nearest(there, options).mean() > options.alike:
        return near, cost
    both = _refined(near, one.points, other, options.steps, replace(options, trim=1.0), back=one)
    better = _cost(*_both(both, one, other, options.points), options)
    return (both, better) if better < cost else (near, cost)


class _Side:
    """A surface with what all steps ask of it.

    Attributes:
        many: (N, 3) points drawn evenly by area.
        points: the first of them.
        index: over it.
        ball: the middle and radius of the ball around it, size-30 units.
        radius: that radius.
    """

    def __init__(self, surface: Surface, options: RegistrationOptions) -> None:
        rng = np.random.default_rng(options.seed)
        self.many, _ = sample(surface, options.many, rng)
        self.points = self.many[: options.points]
        self.index = SpatialIndex(surface.positions, surface.faces)
        self.ball = _ball(self.points)
        self.radius = self.ball[1]

    def extents(self) -> Iterator[tuple[Float, float]]:
        """Middles (3,) of it and its extents from there, size-30 units: by area, and of the ball around it."""
        middle = self.many.mean(axis=0)
        yield middle, float(np.sqrt(((self.many - middle) ** 2).sum(axis=1).mean()))
        yield self.ball


def _ball(points: Float, steps: int = 300) -> tuple[Float, float]:
    """The middle (3,) and the radius of about the smallest ball around ``points`` (Badoiu and Clarkson 2003)."""
    center = points.mean(axis=0)
    for step in range(2, steps + 2):
        away = points - center
        center = center + away[int((away * away).sum(axis=1).argmax())] / step
    return center, float(np.linalg.norm(points - center, axis=1).max())


def _identity(suspect: Surface, original: Surface) -> Similarity:
    """World coordinates as they are."""
    scale = original.scale / suspect.scale
    return Similarity(scale, np.eye(3), (suspect.offset - original.offset) * original.scale)


def _principal(suspect: Surface, original: Surface) -> list[Similarity]:
    """The principal axes laid on one another, in the four ways that are no reflections."""
    (middle, extent, axes), (target, size, onto) = _moments(suspect), _moments(original)
    scale = size / extent
    turns = [onto @ np.diag(signs) @ axes.T for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
    return [Similarity(scale, turn, target - scale * turn @ middle) for turn in turns]


def _moments(surface: Surface) -> tuple[Float, float, Float]:
    """The middle (3,) by area, the extent from there, and the principal axes in columns (3, 3), right-handed."""
    corners = surface.positions[surface.faces]
    weight = surface.areas / surface.areas.sum()
    centers = corners.mean(axis=1)
    middle = weight @ centers
    away, rest = centers - middle, corners - middle
    spread = (9 * np.einsum("f,fi,fj->ij", weight, away, away) + np.einsum("f,fki,fkj->ij", weight, rest, rest)) / 12
    axes = np.linalg.eigh(spread)[1]
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return middle, float(np.sqrt(np.trace(spread))), axes


def _rotations(count: int) -> Float:
    """(count, 3, 3) rotations spread evenly: a spiral on the sphere of quaternions (Alexa 2022)."""
    step = np.arange(count) + 0.5
    inner, outer = np.sqrt(step / count), np.sqrt(1 - step / count)
    first, second = 2 * np.pi * step / np.sqrt(2), 2 * np.pi * step / 1.533751168755204288118041
    x, y, z, w = inner * np.sin(first), inner * np.cos(first), outer * np.sin(second), outer * np.cos(second)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _turned(one: _Side, other: _Side, options: RegistrationOptions) -> list[Similarity]:
    """The best alignments of all rotations about the middles."""
    turns = _rotations(options.turns)
    there, back = _Distances(other.many, options), _Distances(one.many, options)
    found: list[tuple[float, Similarity]] = []
    for (middle, extent), (target, size) in zip(one.extents(), other.extents(), strict=True):
        scale, few = size / extent, options.few
        mine, theirs = one.points[:few] - middle, other.points[:few] - target
        cap = options.cap * other.radius * 2
        cost = np.concatenate(
            [
                np.minimum(there(scale * mine @ part.transpose(0, 2, 1) + target), cap).mean(axis=1)
                + np.minimum(scale * back(theirs @ part / scale + middle), cap).mean(axis=1)
                for part in np.array_split(turns, 8)
            ]
        )
        for number in np.argsort(cost, kind="stable")[: 20 * options.refined].tolist():
            turn = turns[number]
            found.append((float(cost[number]), Similarity(scale, turn, target - scale * turn @ middle)))
    found.sort(key=lambda each: each[0])
    return _distinct([each for _, each in found], options)[: options.refined]


class _Distances:
    """A grid of distances to (N, 3) ``points``, size-30 units."""

    def __init__(self, points: Float, options: RegistrationOptions) -> None:
        self.reach, self.cells = options.reach, options.cells
        empty = np.ones((self.cells,) * 3, dtype=bool)
        empty[tuple(self._cell(points).T)] = False
        self.grid = (distance_transform_edt(empty) * (2 * self.reach / self.cells)).astype(np.float32).ravel()

    def _cell(self, points: Float) -> Float:
        cell = ((points + self.reach) * (self.cells / (2 * self.reach))).astype(np.int64)
        return np.clip(cell, 0, self.cells - 1)

    def __call__(self, points: Float) -> Float:
        cell = self._cell(points)
        return np.asarray(self.grid[(cell[..., 0] * self.cells + cell[..., 1]) * self.cells + cell[..., 2]])


def _angle(one: Similarity, other: Similarity) -> float:
    return float(np.arccos(np.clip((np.trace(one.rotation.T @ other.rotation) - 1) / 2, -1, 1)))


def _distinct(found: list[Similarity], options: RegistrationOptions) -> list[Similarity]:
    """Those that turn otherwise than all before them."""
    kept: list[Similarity] = []
    for each in found:
        if all(_angle(each, before) >= options.apart for before in kept):
            kept.append(each)
            if len(kept) == options.refined:
                break
    return kept


def _refined(
    start: Similarity,
    points: Float,
    other: _Side,
    steps: int,
    options: RegistrationOptions,
    back: _Side | None = None,
) -> Similarity:
    """An alignment after steps towards the planes of the closest points of the nearest share of ``points`` (N, 3), and
    of the other side's to the side where they come from, ``back``, if that is given."""
    found = start
    for _ in range(steps):
        moved, away, normal = _pairs(found(points), other, options, rims=back is not None)
        if back is not None:
            theirs, there, facing = _pairs(found.inverse()(other.points), back, options, rims=True)
            here, turned = -found.scale * product(there, found.rotation.T), product(facing, found.rotation.T)
            moved = np.concatenate([moved, found(theirs) - here])
            away, normal = np.concatenate([away, here]), np.concatenate([normal, turned])
        middle = moved.mean(axis=0)
        arm = moved - middle
        # Linear in a small rotation, a translation and a relative change of scale about the middle.
        rows = np.concatenate([cross(arm, normal), normal, (arm * normal).sum(axis=1, keepdims=True)], axis=1)
        extent = float(np.sqrt((arm**2).sum(axis=1).mean())) or 1.0
        units = np.array([extent] * 3 + [1.0] * 3 + [extent])
        rows = rows / units
        off = (away * normal).sum(axis=1)
        # Directions in which nothing holds the surface, as a sphere's rotations, stay as they are.
        change = np.linalg.pinv(rows.T @ rows, rcond=1e-6, hermitian=True) @ (rows.T @ off) / units
        limits = options.growth ** np.array([-1, 1]) * start.scale / found.scale
        turn, growth = _small(change[:3]), float(np.clip(np.exp(np.clip(change[6], -0.2, 0.2)), *limits))
        step = Similarity(growth, turn, middle + change[3:6] - growth * turn @ middle)
        found = step.after(found)
        if np.abs(change * units).max() < 1e-6 * other.radius:
            break
    return found


def _pairs(points: Float, other: _Side, options: RegistrationOptions, rims: bool) -> tuple[Float, Float, Float]:
    """The nearest share of ``points`` (N, 3), the way from each to the other surface, and the unit direction in which
    that counts: its normal. With ``rims`` it is the way itself where the closest point lies beside and not under it,
    on an edge; from far away that is slower."""
    count = max(int(options.trim * len(points)), 7)
    distance, face, nearest = other.index.closest(points)
    near = np.argpartition(distance, count - 1)[:count]
    away, normal = nearest[near] - points[near], other.index.normals(face[near])
    if rims:
        normal = np.where(distance[near, None] > BESIDE * other.radius, unit(away), normal)
    return points[near], away, normal


def _small(vector: Float) -> Float:
    """(3, 3) rotation about ``vector`` by its length in radians, at most half a radian."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    angle = min(angle, 0.5)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew)


def _both(found: Similarity, one: _Side, other: _Side, count: int) -> tuple[Float, Float]:
    """Distances of ``count`` points of the suspect to the original and back, over the original's radius."""
    there, _, _ = other.index.closest(found(one.points[:count]))
    back, _, _ = one.index.closest(found.inverse()(other.points[:count]))
    return there / other.radius, back * found.scale / other.radius


def _cost(there: Float, back: Float, options: RegistrationOptions) -> float:
    return float(sum(np.minimum(each, options.cap).mean() for each in (there, back)))


def _nearest(there: Float, options: RegistrationOptions) -> Float:
    """The share of the distances that an alignment is measured by."""
    return np.sort(there)[: int(options.trim * len(there))]


def _measured(found: Similarity, one: _Side, other: _Side, options: RegistrationOptions) -> Registration:
    there, back = _both(found, one, other, options.points)
    best = _nearest(there, options)
    size = found.scale * one.radius / other.radius
    return Registration(found, float(np.sqrt((best**2).mean())) / size, float((back < options.near).mean()))
