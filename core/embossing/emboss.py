"""Embosses one watermark into the working mesh: patches, islands assigned to them, cut, draft, lift, check."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from manifold3d import CrossSection

from core.analysis.contrast import OWN, Look
from core.arrays import Bool, Float, Int
from core.embossing.check import is_closed
from core.embossing.cut_arrange import arrange
from core.embossing.cut_split import split
from core.embossing.draft import Draft
from core.embossing.height_field import HeightField, height_field
from core.embossing.islands import LetterIslands, assign_to_patches
from core.embossing.lift import MIN_AGREEMENT, folded, inverted, lift, obstructed
from core.embossing.mesh import WorkingMesh
from core.embossing.patch import Patch, single_valued_patches
from core.embossing.pieces import Pieces
from core.embossing.refusal import Refusal
from core.embossing.soft import Displaced, displaced
from core.geometry.boxes import Boxes
from core.geometry.edges import boundary_edges, connected, directed_edges
from core.geometry.grouping import among
from core.geometry.products import cross, length, product
from core.geometry.spatial import SpatialIndex
from core.geometry.triangles import barycentric
from core.gltf.edit import Kind

Cut = Callable[[Patch, CrossSection], Pieces | None]
Method = Literal["split", "arrangement", "delaunay"]
CUTS: tuple[tuple[Method, Cut], ...] = (("split", split), ("arrangement", arrange))
SLACK = 0.05  # reliefs between the letters and the faces of their bounds, so that the surface under them is inside
FINEST = 4  # spacings of the file's coordinates; least length of a new edge
COARSE = 1000  # spacings of the file's coordinates; soft letters of a lower relief may be flat instead

FINAL = (Refusal.SECOND_LAYER, Refusal.THIN_WALL, Refusal.FOLDED)  # which a small shift does not help against


@dataclass(frozen=True)
class EmbossOptions:
    """Values of :func:`emboss`: both ours; the paper unites solids.

    Attributes:
        shifts: line heights along the text and across it, tried in turn; imperceptible, they break coincidences of
            outline and mesh.
        ease_rounds: in which the draft of caps that would be inverted is halved, at most.
    """

    shifts: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.0104, 0.0072), (-0.0088, 0.0136))
    ease_rounds: int = 6


EMBOSS = EmbossOptions()


@dataclass(frozen=True)
class Mark:
    """A watermark that passed its check.

    Attributes:
        box: a single box.
        cut: the method of cutting that succeeded.
        faces: number of triangles added, less those replaced.
        relief: height of its letters, size-30 units; negative where they are sunken.
        bounds: the box without its room above and below the letters, where the other side of a thin wall may be.
        look: of its letters.
    """

    box: Boxes
    cut: Method
    faces: int
    relief: float
    bounds: Boxes
    look: Look = OWN


def emboss(
    mesh: WorkingMesh,
    box: Boxes,
    letters: LetterIslands,
    relief: float,
    index: SpatialIndex,
    options: EmbossOptions = EMBOSS,
) -> Mark | Refusal:
    """Embosses ``letters`` at the one ``box``, or leaves ``mesh`` exactly as it was and returns the reason.

    Soft letters are flat where the file's coordinates are too coarse for their contours; the mark's ``cut`` says so.

    Args:
        mesh: changed in place on success only.
        box: a single box, its width the text's width; size-30 frame.
        letters: the islands in text widths.
        relief: size-30 units; negative sinks the letters.
        index: of the original surface.
        options: tuned values.
    """
    refusal = Refusal.NOT_WHOLE
    for shift in options.shifts:
        moved = Boxes(
            box.center + product(box.size[0, 1] * letters.line * np.array([shift]), box.axes[0, :2]), box.axes, box.size
        )
        used = _lettered_patches(mesh, moved, letters, relief, index, letters.reach)
        if letters.reach and isinstance(used, Refusal):
            used = _lettered_patches(mesh, moved, letters, relief, index, 0.0)
        if isinstance(used, Refusal):
            return used
        if letters.soft is not None:
            outcome = _displace(mesh, moved, used, letters.soft, relief, index)
            if not isinstance(outcome, Refusal):
                faces, bounds = outcome
                return Mark(moved, "delaunay", faces, relief, bounds)
            if outcome in FINAL:
                return outcome
            refusal = outcome
            under = np.concatenate([patch.faces for patch, _ in used])
            if refusal is not Refusal.TOO_FINE or abs(relief) > COARSE * mesh.resolution(under):
                continue  # else flat letters, whose triangles are larger, may still be held by the file
        for name, cut in CUTS:
            cuts = _cut_patches(mesh, moved, used, cut, letters.draft)
            outcome = cuts if isinstance(cuts, Refusal) else _lift_letters(mesh, moved, cuts, relief, index, options)
            if outcome is Refusal.TOO_FINE and not isinstance(cuts, Refusal):  # edges of smaller tops are shorter
                upright = [replace(each, shift=np.zeros_like(each.shift)) for each in cuts]
                outcome = _lift_letters(mesh, moved, upright, relief, index, options)
            if not isinstance(outcome, Refusal):
                faces, bounds = outcome
                return Mark(moved, name, faces, relief, bounds)
            if outcome in FINAL:
                return outcome
            refusal = outcome
            if refusal is Refusal.TOO_FINE:
                break  # the outlines lie too close to vertices, however they are cut
    return refusal


def _lettered_patches(
    mesh: WorkingMesh, box: Boxes, letters: LetterIslands, relief: float, index: SpatialIndex, beside: float
) -> list[tuple[Patch, CrossSection]] | Refusal:
    """The patches in ``box`` that carry letters, up to ``beside`` text widths round the text, each with its letters."""
    found = single_valued_patches(mesh, box, index, beside)
    if isinstance(found, Refusal):
        return found
    under = np.concatenate([np.empty(0, dtype=np.int64), *(patch.faces for patch in found)])
    if box.size[0, 0] * letters.finest < FINEST * mesh.resolution(under):
        return Refusal.TOO_FINE
    sources = [mesh.source(patch.faces) for patch in found]
    assigned = assign_to_patches(letters, found, sources, box, index, raised=relief > 0)
    if isinstance(assigned, Refusal):
        return assigned
    used = [(patch, text) for patch, text in zip(found, assigned, strict=True) if not text.is_empty()]
    if relief < 0 and any(mesh.has_remaining_copy(patch.faces).any() for patch, _ in used):
        return Refusal.SECOND_LAYER
    return used


def _displace(
    mesh: WorkingMesh,
    box: Boxes,
    used: list[tuple[Patch, CrossSection]],
    field: HeightField,
    relief: float,
    index: SpatialIndex,
) -> tuple[int, Boxes] | Refusal:
    """Puts soft letters into the mesh; as :func:`_lift_letters`."""
    parts: list[Displaced] = []
    first = len(mesh.points)
    for patch, text in used:
        own = field if len(used) == 1 else height_field(text, field.stroke)
        part = displaced(mesh, box, patch, own, relief, index, first)
        if isinstance(part, Refusal):
            return part
        first += len(part.points)
        parts.append(part)
    removed, points, bases, tilts, corners, source, kind, letters = (
        np.concatenate([getattr(part, name) for part in parts]) for name in Displaced.__dataclass_fields__
    )
    if _too_fine(mesh.positions(corners, points), corners, mesh.corners(removed), mesh.resolution(removed)):
        return Refusal.TOO_FINE
    mesh.add_points(points, bases, tilts)
    mesh.replace(removed, corners, source, kind)
    return len(corners) - len(removed), _bounds(box, letters, relief)


@dataclass(frozen=True, eq=False)
class _PatchCut:
    """One patch's replacement in topological vertices, letters not yet lifted."""

    removed: Int  # (K,) face ids
    removed_corners: Int  # (K, 3)
    boundary: Int  # (E, 2)
    points: Float  # (N, 3) new vertices on the surface, numbered from the mesh's end
    rest: Int  # (R, 3)
    rest_source: Int
    letters: Int  # (L, 3) on the surface
    letter_source: Int
    base: Int  # (T,) the vertices of ``letters``
    normals: Float  # (T, 3) smooth normals there
    shift: Float  # (T, 3) along the surface, of the draft


def _cut_patches(
    mesh: WorkingMesh, box: Boxes, used: list[tuple[Patch, CrossSection]], cut: Cut, draft: Draft
) -> list[_PatchCut] | Refusal:
    """Each patch cut along the outlines of its letters; the mesh stays as it is."""
    cuts: list[_PatchCut] = []
    first = len(mesh.points)
    for patch, text in used:
        pieces = cut(patch, text)
        if pieces is None:
            return Refusal.CUT_FAILED
        found = _patch_cut(mesh, box, patch, pieces, draft, first)
        added = np.concatenate([found.rest, found.letters])
        if not is_closed(found.removed_corners, found.boundary, added):
            return Refusal.NOT_CLOSED
        first += len(found.points)
        cuts.append(found)
    return cuts


def _lift_letters(
    mesh: WorkingMesh,
    box: Boxes,
    cuts: list[_PatchCut],
    relief: float,
    index: SpatialIndex,
    options: EmbossOptions,
) -> tuple[int, Boxes] | Refusal:
    """Lifts the letters of all cuts off the surface and puts the result into the mesh; the triangles added, less those
    removed, and the bounds of the letters (:class:`Mark`)."""
    known = len(mesh.points)
    new = np.concatenate([s.points for s in cuts])
    base = np.concatenate([s.base for s in cuts])
    letters = np.concatenate([s.letters for s in cuts])
    letter_source = np.concatenate([s.letter_source for s in cuts])
    normals = np.concatenate([s.normals for s in cuts])
    shift = np.concatenate([s.shift for s in cuts])
    normal = box.axes[0, 2]

    # Tops are numbered after everything on the surface, in the order of `base`. Nothing here is as long as the mesh.
    order = np.argsort(base)
    base, normals, shift = base[order], normals[order], shift[order]
    caps = np.searchsorted(base, letters)
    base_points = mesh.positions(base, new)
    base_letters = _Bases(base_points, shift, normals, caps)
    tops = _caps(base_letters, normal, relief, index, options)
    if isinstance(tops, Refusal):
        return tops

    outline = boundary_edges(letters)
    first_top = known + len(new)
    top = np.searchsorted(base, outline) + first_top
    walls = np.concatenate(
        [np.column_stack([outline, top[:, 1]]), np.column_stack([outline[:, 0], top[:, 1], top[:, 0]])]
    )
    wall_source = np.tile(_source_of_edges(letters, letter_source, outline), 2)
    rest = np.concatenate([s.rest for s in cuts])
    rest_source = np.concatenate([s.rest_source for s in cuts])
    corners = np.concatenate([rest, caps + first_top, walls])
    removed = np.concatenate([s.removed for s in cuts])
    removed_corners = np.concatenate([s.removed_corners for s in cuts])
    boundary = np.concatenate([s.boundary for s in cuts])
    if not is_closed(removed_corners, boundary, corners):
        return Refusal.NOT_CLOSED
    added_points = np.concatenate([new, tops])
    if _too_fine(mesh.positions(corners, added_points), corners, removed_corners, mesh.resolution(removed)):
        return Refusal.TOO_FINE

    mesh.add_points(added_points, np.concatenate([new, base_points]))
    kind = np.repeat([Kind.SURFACE, Kind.CAP, Kind.WALL], [len(rest), len(caps), len(walls)]).astype(np.int8)
    mesh.replace(removed, corners, np.concatenate([rest_source, letter_source, wall_source]), kind)
    return len(corners) - len(removed), _bounds(box, np.concatenate([base_points, tops]), relief)


def _bounds(box: Boxes, points: Float, relief: float) -> Boxes:
    """The one ``box`` no thicker than the ``points`` (N, 3) of its letters need, and :data:`SLACK`."""
    height, slack = box.to_local(0, points)[:, 2], SLACK * abs(relief)
    low, high = height.min() - slack, height.max() + slack
    center = box.center + (low + high) / 2 * box.axes[:, 2]
    return Boxes(center, box.axes, np.column_stack([box.size[:, :2], [high - low]]))


@dataclass(frozen=True, eq=False)
class _Bases:
    """The letters of a mark on the surface, with the shift of their caps."""

    points: Float  # (T, 3)
    shift: Float  # (T, 3) along the surface, of the draft
    normals: Float  # (T, 3) smooth normals there
    triangles: Int  # (L, 3)


def _caps(bases: _Bases, normal: Float, relief: float, index: SpatialIndex, options: EmbossOptions) -> Float | Refusal:
    """(T, 3) cap vertices above the ``bases``. Letters that the draft would turn over, or that would meet other surface
    with it, have none; no letter has any where that does not help, so that no watermark is refused because of it."""
    first, second, third = bases.triangles.T
    letter = connected(len(bases.points), np.concatenate([first, second]), np.concatenate([second, third]))
    drafted = bases
    while True:
        tops, refusal, failing = _lifted_caps(drafted, normal, relief, index, options)
        if refusal is None:
            return tops
        if not drafted.shift.any():
            return refusal
        kept = np.where(among(letter, letter[failing])[:, None], 0.0, drafted.shift)
        drafted = replace(bases, shift=kept if (kept != drafted.shift).any() else np.zeros_like(kept))


def _lifted_caps(
    bases: _Bases, normal: Float, relief: float, index: SpatialIndex, options: EmbossOptions
) -> tuple[Float, Refusal | None, Bool]:
    """(T, 3) cap vertices above the ``bases``, lifted along their normals or, where these diverge too much, along the
    box ``normal``; the reason why they cannot stand, and (T,) those to which it applies."""
    for along in (bases.normals, np.broadcast_to(normal, bases.normals.shape)):
        points, tops = _draft_and_lift(replace(bases, normals=along), normal, relief, index, options)
        failing = np.zeros(len(tops), dtype=bool)
        if not folded(tops, bases.triangles, normal):
            # Feet that the draft has shifted along the tangents of bent ground are above or below it.
            failing = obstructed(index.closest(points)[2] if bases.shift.any() else points, tops, relief, index)
            beyond = Refusal.SECOND_LAYER if relief > 0 else Refusal.THIN_WALL
            return tops, beyond if failing.any() else None, failing
        failing[bases.triangles[inverted(tops, bases.triangles, normal)]] = True
    return tops, Refusal.FOLDED, failing


def _draft_and_lift(
    bases: _Bases, normal: Float, relief: float, index: SpatialIndex, options: EmbossOptions
) -> tuple[Float, Float]:
    """(T, 3) each: the points of the ``bases`` shifted, by less where one of their triangles would be inverted, and the
    cap vertices above them, along their normals."""
    drafted, along = bases.points + bases.shift, bases.normals
    tops = lift(drafted, along, relief, index)
    for _ in range(options.ease_rounds if bases.shift.any() else 0):
        eased = np.unique(bases.triangles[inverted(tops, bases.triangles, normal)])
        if not len(eased):
            break
        drafted[eased] = (bases.points[eased] + drafted[eased]) / 2
        tops[eased] = lift(drafted[eased], along[eased], relief, index)
    return drafted, tops


def _patch_cut(mesh: WorkingMesh, box: Boxes, patch: Patch, pieces: Pieces, draft: Draft, first: int) -> _PatchCut:
    """The cut of one patch in the mesh's own numbers; new vertices are numbered from ``first``."""
    known = len(patch.points)
    new = box.center[0] + box.size[0, 0] * product(pieces.points[known:], box.axes[0])
    vertices = np.concatenate([patch.vertices, np.arange(first, first + len(new))])
    source = mesh.source(patch.faces)

    # Smooth normals of the patch's own vertices, interpolated to the letters' vertices.
    corners = patch.points[patch.triangles]
    face_normal = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    vertex_normal = np.zeros((known, 3))
    for corner in range(3):
        np.add.at(vertex_normal, patch.triangles[:, corner], face_normal)
    vertex_normal /= np.maximum(np.linalg.norm(vertex_normal, axis=1, keepdims=True), np.finfo(float).tiny)
    local, where, flat = np.unique(pieces.letters, return_index=True, return_inverse=True)
    face = pieces.letter_faces[where // 3]
    weight = barycentric(pieces.points[local][:, None], corners[face])[:, 0]
    normals = np.einsum("tk,tkj->tj", weight, vertex_normal[patch.triangles[face]])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    normals[normals[:, 2] < MIN_AGREEMENT] = (0.0, 0.0, 1.0)
    across = draft.of(pieces.points[local, :2], flat.reshape(-1, 3))
    # In the tangent plane, and seen along the box normal exactly the draft.
    along = -np.sum(across * normals[:, :2], axis=1, keepdims=True) / normals[:, 2:]

    return _PatchCut(
        removed=patch.faces,
        removed_corners=patch.vertices[patch.triangles],
        boundary=patch.vertices[patch.boundary],
        points=new,
        rest=vertices[pieces.rest],
        rest_source=source[pieces.rest_faces],
        letters=vertices[pieces.letters],
        letter_source=source[pieces.letter_faces],
        base=vertices[local],
        normals=product(normals, box.axes[0]),
        shift=box.size[0, 0] * product(np.hstack([across, along]), box.axes[0]),
    )


def _source_of_edges(triangles: Int, sources: Int, edges: Int) -> Int:
    """(E,) the source face of the triangle that has each directed edge."""
    size = int(triangles.max()) + 1
    owned = directed_edges(triangles)
    key = owned[:, 0] * size + owned[:, 1]
    order = np.argsort(key)
    return np.asarray(sources[order[np.searchsorted(key[order], edges[:, 0] * size + edges[:, 1])] // 3])


def _too_fine(points: Float, corners: Int, removed_corners: Int, resolution: float) -> bool:
    """True where a new edge of triangles with ``points`` (M, 3, 3) is so short that its ends may round to one point
    in the file."""
    was_there = np.zeros(int(corners.max()) + 1, dtype=bool)
    was_there[removed_corners[removed_corners < len(was_there)]] = True
    for one, other in ((0, 1), (1, 2), (2, 0)):
        short = length(points[:, one] - points[:, other]) < FINEST * resolution
        if (short & ~(was_there[corners[:, one]] & was_there[corners[:, other]])).any():
            return True
    return False
