"""The analysis of the surface that watermarks are placed on and embossed into."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.analysis.coincident import CoincidentFaces, find_coincident
from core.analysis.orientation import Orientation, orient
from core.arrays import Bool, Float, Int
from core.device import spatial_index
from core.errors import ErrorCode, MeshmarkError
from core.geometry.products import solved
from core.geometry.spatial import Hides, SpatialIndex
from core.geometry.surface import Surface
from core.gltf.edit import SurfaceEdit
from core.gltf.scene import Scene
from core.gltf.viewer import Viewed, drawn_part

HIDING = 0.25  # share of a face's area; with more than that opaque it may carry marks, and occludes


@dataclass(frozen=True, eq=False)
class SurfaceAnalysis:
    """An asset's surface, as it is seen from outside.

    Attributes:
        surface: the scene's, with the winding of the faces in ``flipped`` reversed, so that normals face outwards.
            Faces that are drawn from one side only keep the file's winding. Faces that are not drawn are collapsed.
        flipped: (F,) faces that the file winds inside out.
        component: (F,) number of each distinct face's edge-manifold component: faces connected through edges of exactly
            two. -1 for others.
        coincident: its coincident faces; faces that are not drawn are not distinct.
        opaque: (F,) distinct faces to place watermarks on.
        cuttable: (F,) distinct faces to fall back to: ``opaque`` and the see-through ones.
        index: over the distinct faces; its face numbers are those of ``surface``. View rays pass the undrawn backs of
            one-sided faces, and see-through faces.
        glazed: the same, but see-through faces occlude.
        resolution: (V,) the spacing of the file's 32-bit coordinates at each vertex of ``surface``, size-30 units.
    """

    surface: Surface
    flipped: Bool
    component: Int
    coincident: CoincidentFaces
    opaque: Bool
    cuttable: Bool
    index: SpatialIndex
    glazed: SpatialIndex
    resolution: Float

    def with_file_winding(self, edit: SurfaceEdit) -> SurfaceEdit:
        """An edit of ``surface`` as one of the scene's own: every triangle wound like the face it was cut from."""
        if not self.flipped[edit.corner_face].any():
            return edit
        triangles = np.flatnonzero(self.flipped[edit.source_face])
        barycentric, tilt = edit.barycentric.copy(), edit.tilt.copy()
        within = np.nonzero(self.flipped[edit.corner_face])
        barycentric[within] = barycentric[within][:, [0, 2, 1]]
        tilt[triangles] *= -1

        def turned(corners: NDArray[Any]) -> NDArray[Any]:
            result = corners.copy()
            result[triangles] = corners[triangles][:, [0, 2, 1]]
            return result

        return replace(
            edit,
            vertex=turned(edit.vertex),
            position=turned(edit.position),
            corner_face=turned(edit.corner_face),
            barycentric=turned(barycentric),
            original=turned(edit.original),
            tilt=turned(tilt),
        )


def analyse(scene: Scene) -> SurfaceAnalysis:
    """The :class:`SurfaceAnalysis` of a scene.

    Raises:
        MeshmarkError: ``no_faces`` when every face is collapsed; ``device_unavailable``.
    """
    seen = scene.viewed
    surface = drawn_part(scene.surface, seen.drawn)
    invertible = np.array([drawn.invertible for drawn in scene.primitives])[surface.face_primitive]
    possible = invertible & seen.drawn
    solid = possible & (seen.opacity >= HIDING)
    rank = seen.drawn.astype(np.int64) + possible + solid
    layer = _layer(surface, seen, rank, flip_backed=True)
    inner = layer.orientation.flipped & seen.one_sided
    if inner.any():
        # Of two coincident faces, each drawn from its front only, the one that faces outwards is the distinct one.
        layer = _layer(surface, seen, 2 * rank - inner, flip_backed=False)
    coincident, facing, hides, clear = layer.coincident, layer.orientation, layer.hides.copy(), seen.opacity < HIDING
    # The backs of a closed component cannot be seen: rays need not test the side they meet.
    hides[facing.closed] = Hides.ALWAYS
    if facing.flipped.any():
        faces = np.where(facing.flipped[:, None], surface.faces[:, [0, 2, 1]], surface.faces)
        surface = replace(surface, faces=faces)
    free = coincident.distinct & ~coincident.not_cuttable
    return SurfaceAnalysis(
        surface,
        facing.flipped,
        facing.component,
        coincident,
        solid & free,
        possible & free,
        layer.index.hiding(_through(hides, clear)),
        layer.index.hiding(hides),
        _resolution(scene),
    )


def eye_index(scene: Scene, frame: Surface, *, through: bool = True) -> tuple[Surface, SpatialIndex]:
    """The drawn faces of a scene, in the ``frame`` of another surface, and an index over them for view rays: these pass
    the undrawn backs of one-sided faces and, where ``through``, see-through faces."""
    seen = scene.viewed
    surface = drawn_part(scene.surface.in_frame_of(frame), seen.drawn)
    one_sided, counts = seen.one_sided & seen.drawn, seen.drawn
    if one_sided.any():
        coincident = find_coincident(surface, seen.drawn.astype(np.int64))
        counts = coincident.distinct & seen.drawn
        one_sided &= ~_back_shown(surface, seen, coincident)
    hides = np.where(one_sided, Hides.FROM_FRONT, Hides.ALWAYS).astype(np.uint8)
    if through:
        hides = _through(hides, seen.opacity < HIDING)
    return surface, SpatialIndex(surface.positions, surface.faces, np.flatnonzero(counts), hides)


@dataclass(frozen=True, eq=False)
class _Layer:
    """The distinct faces and their winding; arrays and ``index`` as in :class:`SurfaceAnalysis`."""

    coincident: CoincidentFaces
    orientation: Orientation
    hides: NDArray[np.uint8]
    index: SpatialIndex


def _layer(surface: Surface, seen: Viewed, rank: Int, *, flip_backed: bool) -> _Layer:
    """The layer of the coincident faces with the highest ``rank`` (F,). Faces that are drawn from their front only may
    be flipped where ``flip_backed`` and a coincident face shows their back."""
    coincident = find_coincident(surface, rank)
    distinct = coincident.distinct & seen.drawn
    if not distinct.any():
        raise MeshmarkError(
            ErrorCode.NO_FACES,
            f"All {len(surface.faces)} faces of this file are collapsed: two of their corners are one point.",
            "Export the model with its surface, not only points, lines or collapsed triangles.",
        )
    one_sided, clear = seen.one_sided & ~_back_shown(surface, seen, coincident), seen.opacity < HIDING
    hides = np.where(one_sided, Hides.FROM_FRONT, Hides.ALWAYS).astype(np.uint8)
    glazed = spatial_index(surface.positions, surface.faces, np.flatnonzero(distinct), hides=hides)
    fixed = one_sided if flip_backed else seen.one_sided
    facing = orient(surface, distinct, fixed, clear, glazed.hiding(_through(hides, clear)), glazed)
    return _Layer(replace(coincident, distinct=distinct), facing, hides, glazed)


def _through(hides: NDArray[np.uint8], clear: Bool) -> NDArray[np.uint8]:
    """(F,) the :class:`Hides` of faces for rays that pass those that are ``clear`` (F,)."""
    return np.where(clear, Hides.NEVER, hides).astype(np.uint8)


def _back_shown(surface: Surface, seen: Viewed, coincident: CoincidentFaces) -> Bool:
    """(F,) distinct faces with a coincident one that shows their back: a face of opposite orientation, or one that is
    drawn from both sides."""
    of, copy = coincident.copies.T
    opposite = np.einsum("ni,ni->n", surface.normals[of], surface.normals[copy]) < 0
    shown = np.zeros(len(surface.faces), dtype=bool)
    shown[of[seen.drawn[copy] & (opposite | ~seen.one_sided[copy])]] = True
    return shown


def _resolution(scene: Scene) -> Float:
    """(V,) the spacing of float32 at the local coordinates of each vertex, as long as it is in the world."""
    surface = scene.surface
    spacing = np.zeros(len(surface.positions))
    for drawn in scene.primitives:
        rows = slice(drawn.first_vertex, drawn.first_vertex + int(drawn.triangles.max()) + 1)
        local: Float = surface.to_world(surface.positions[rows])
        stretch = 1.0
        if len(drawn.matrices) == 1 and drawn.invertible:
            matrix, shift = drawn.matrices[0, :, :3], drawn.matrices[0, :, 3]
            local = solved(matrix, local - shift)
            stretch = float(np.linalg.norm(matrix, axis=0).max())
        largest = np.abs(local).max(axis=1).astype(np.float32)
        spacing[rows] = np.spacing(largest).astype(np.float64) * (stretch * surface.scale)
    return spacing
