"""The mesh that is cut: original faces, some of them removed, and the faces that replace them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.analysis.coincident import CoincidentFaces, single_layer
from core.arrays import Bool, Float, Int
from core.geometry.grouping import among, first_of_each, without_copies
from core.geometry.surface import Surface
from core.geometry.triangles import barycentric
from core.gltf.edit import Kind, SurfaceEdit

CELL = 1.0  # size-30 units; about a fifth of a usual text width, so that a query reads few cells


class FaceGrid:
    """Faces by the grid cell of their bounding-box centre; the few that are larger than a cell apart.

    Args:
        low, high: (F, 3) bounding boxes of the faces, size-30 frame.
        counts: (F,) bool, the faces that queries return; all if None.
    """

    def __init__(self, low: Float, high: Float, counts: Bool | None = None) -> None:
        self._low, self._high = low, high
        is_large = (high - low).max(axis=1) > CELL
        counts = np.ones(len(low), dtype=bool) if counts is None else counts
        self._large = np.flatnonzero(is_large & counts)
        small = np.flatnonzero(~is_large & counts)
        center = (low[small] + high[small]) / 2
        self._origin = center.min(axis=0) if len(small) else np.zeros(3)
        cell = np.floor((center - self._origin) / CELL).astype(np.int64)
        self._shape = cell.max(axis=0) + 1 if len(small) else np.ones(3, dtype=np.int64)
        key = (cell[:, 0] * self._shape[1] + cell[:, 1]) * self._shape[2] + cell[:, 2]
        order = np.argsort(key, kind="stable")
        self._small = small[order]
        self._start = np.searchsorted(key[order], np.arange(int(np.prod(self._shape)) + 1))

    def overlapping(self, low: Float, high: Float) -> Int:
        """Faces whose bounding box meets the box ``low``-``high`` ((3,) each)."""
        first = np.maximum(np.floor((low - CELL / 2 - self._origin) / CELL).astype(np.int64), 0)
        last = np.minimum(np.floor((high + CELL / 2 - self._origin) / CELL).astype(np.int64), self._shape - 1)
        found = [self._large]
        if np.all(last >= first):
            for x in range(first[0], last[0] + 1):
                for y in range(first[1], last[1] + 1):
                    row = (x * self._shape[1] + y) * self._shape[2]
                    found.append(self._small[self._start[row + first[2]] : self._start[row + last[2] + 1]])
        faces = np.concatenate(found)
        return np.sort(faces[_meet(self._low[faces], self._high[faces], low, high)])


class Rows:
    """Rows of three numbers with spare capacity, so that a watermark costs its own points and not all of them."""

    def __init__(self, rows: Float) -> None:
        self._buffer, self._length = rows, len(rows)

    @property
    def rows(self) -> Float:
        """(N, 3) a view of the rows there are."""
        return self._buffer[: self._length]

    def append(self, rows: Float) -> None:
        """Add (M, 3) ``rows``."""
        length = self._length + len(rows)
        if length > len(self._buffer):
            grown = np.empty((length + length // 4, 3))
            grown[: self._length] = self.rows
            self._buffer = grown
        self._buffer[self._length : length] = rows
        self._length = length


class WorkingMesh:
    """An asset's triangles by topological vertex: original rows welded, new vertices appended.

    Faces below ``original_faces`` are the surface's own; later ones were cut by a watermark. ``bases`` are the
    points of the vertices on the original surface: their own positions, except for lifted cap vertices.

    Args:
        surface: the asset.
        editable: (F,) bool, faces that may carry a watermark.
        coincident: coincident faces. Those that are not distinct stay in the file and no query returns them, but
            duplicates are removed with the face they duplicate. A single layer if None.
        resolution: (V,) the spacing of the file's coordinates at each vertex of ``surface``, size-30 units; closer
            points may become one in the file. If None, that of float32 at the largest world coordinate.
    """

    def __init__(
        self,
        surface: Surface,
        editable: Bool,
        coincident: CoincidentFaces | None = None,
        resolution: Float | None = None,
    ) -> None:
        self.surface = surface
        self.original_faces = len(surface.faces)
        corners = surface.weld[surface.faces]
        vertices = int(surface.weld.max()) + 1
        original = np.zeros((vertices, 3))
        original[surface.weld] = surface.positions
        self._points, self._bases = Rows(original), Rows(original)
        self._tilts = Rows(np.zeros_like(original))
        self._corners = corners
        self._alive = np.ones(self.original_faces, dtype=bool)
        self._editable = editable
        self._coincident = coincident if coincident is not None else single_layer(self.original_faces)
        self._grid = FaceGrid(*_bounds(original, corners), self._coincident.distinct)
        self._new_corners = np.empty((0, 3), dtype=np.int64)
        self._new_source = np.empty((0, 3), dtype=np.int64)
        self._new_kind = np.empty(0, dtype=np.int8)
        self._new_mark = np.empty(0, dtype=np.int64)
        self._mark_bounds = np.empty((0, 3)), np.empty((0, 3))
        self._new_alive = np.empty(0, dtype=bool)
        if resolution is None:
            largest = np.abs(surface.to_world(surface.positions)).max()
            spacing = float(np.spacing(np.float32(largest))) * surface.scale
            resolution = np.full(len(surface.positions), spacing)
        self._resolution = resolution

    @property
    def points(self) -> Float:
        """(N, 3) vertex positions, size-30 frame."""
        return self._points.rows

    @property
    def bases(self) -> Float:
        """(N, 3) bases of the vertices on the original surface."""
        return self._bases.rows

    def positions(self, vertices: Int, new: Float) -> Float:
        """(..., 3) positions of ``vertices`` (...); those past the mesh's own are rows of ``new``."""
        known, flat = len(self.points), vertices.ravel()
        is_new = flat >= known
        result = self.points[np.where(is_new, 0, flat)]
        added = np.flatnonzero(is_new)
        result[added] = new[flat[added] - known]
        return result.reshape(*vertices.shape, 3)

    def near(self, low: Float, high: Float) -> Int:
        """Ids of the faces, removed ones excluded, whose bounding box meets ``low``-``high``."""
        old = self._grid.overlapping(low, high)
        old = old[self._alive[old] & self._coincident.distinct[old]]
        new = np.flatnonzero(self._new_alive & _meet(*self._mark_bounds, low, high)[self._new_mark])
        new = new[_meet(*_bounds(self.points, self._new_corners[new]), low, high)]
        return np.concatenate([old, new + self.original_faces])

    def corners(self, ids: Int) -> Int:
        """(N, 3) topological vertices of faces ``ids``."""
        return self._read(ids, self._corners, self._new_corners)

    def source(self, ids: Int) -> Int:
        """(N,) the surface face of each of ``ids``: itself, or the one that it, or its first corner, was cut from."""
        return self._read(ids, np.arange(self.original_faces), self._new_source[:, 0])

    def editable(self, ids: Int) -> Bool:
        """(N,) true for faces that a watermark may cut: never letters or their walls."""
        return self._read(ids, self._editable, self._new_kind == Kind.SURFACE)

    def has_reversed_copy(self, ids: Int) -> Bool:
        """(N,) true for faces with a coincident copy of the opposite winding that shares their vertices."""
        return np.asarray(self._coincident.has_reversed_copy[self.source(ids)])

    def has_remaining_copy(self, ids: Int) -> Bool:
        """(N,) true for faces with a coincident copy that remains when they are cut."""
        return np.asarray(self._coincident.has_remaining_copy[self.source(ids)])

    def resolution(self, ids: Int) -> float:
        """The widest spacing of the file's coordinates on the faces ``ids`` (N,), size-30 units."""
        return float(self._resolution[self.surface.faces[self.source(ids)]].max(initial=0.0))

    def _read(self, ids: Int, old: NDArray[Any], new: NDArray[Any]) -> NDArray[Any]:
        is_old = ids < self.original_faces
        result = np.empty((len(ids), *old.shape[1:]), dtype=old.dtype)
        result[is_old] = old[ids[is_old]]
        result[~is_old] = new[ids[~is_old] - self.original_faces]
        return result

    def add_points(self, points: Float, bases: Float, tilts: Float | None = None) -> Int:
        """Append (N, 3) vertices, with the ``tilt`` of each that :class:`core.gltf.edit.SurfaceEdit` has; returns their
        ids."""
        first = len(self.points)
        self._points.append(points)
        self._bases.append(bases)
        self._tilts.append(np.zeros_like(points) if tilts is None else tilts)
        return np.arange(first, first + len(points))

    def replace(self, removed: Int, corners: Int, source: Int, kind: NDArray[np.int8]) -> None:
        """Remove the faces ``removed`` and add the (M, 3) ``corners`` of one mark, cut from the surface faces
        ``source``: (M,), or (M, 3), one for each corner, where triangles reach over several. Faces of
        an earlier mark that this one cuts again count as this one's."""
        source = np.repeat(source[:, None], 3, axis=1) if source.ndim == 1 else source
        original = removed[removed < self.original_faces]
        self._alive[original] = False
        duplicated, duplicate = self._coincident.duplicates.T
        self._alive[duplicate[among(duplicated, original)]] = False
        self._new_alive[removed[removed >= self.original_faces] - self.original_faces] = False
        self._new_corners = np.concatenate([self._new_corners, corners])
        self._new_source = np.concatenate([self._new_source, source])
        self._new_kind = np.concatenate([self._new_kind, kind])
        self._new_mark = np.concatenate([self._new_mark, np.full(len(corners), len(self._mark_bounds[0]))])
        self._new_alive = np.concatenate([self._new_alive, np.ones(len(corners), dtype=bool)])
        low, high = _bounds(self.points, corners)
        lowest, highest = self._mark_bounds
        least, most = ([bound(axis) for axis in side.T] for bound, side in ((np.min, low), (np.max, high)))
        self._mark_bounds = np.vstack([lowest, least]), np.vstack([highest, most])

    def _weights(self, corners: Int, source: Int) -> Float:
        """(M, 3, 3) barycentric coordinates of the bases of ``corners`` (M, 3) in the surface faces ``source`` (M, 3).

        Most corners of a vertex have one source: its coordinates are calculated once.
        """
        vertex, face = corners.ravel(), source.ravel()
        first = first_of_each(vertex)
        own, number = without_copies(first, face != face[first])
        triangles = self.surface.positions[self.surface.faces[face[own]]]
        weights = barycentric(self.bases[vertex[own], None], triangles)[:, 0]
        return weights[number].reshape(*corners.shape, 3)

    def edit(self) -> SurfaceEdit:
        """All changes, as the input of the lossless writer."""
        living = self._new_alive
        corners, source = self._new_corners[living], self._new_source[living]
        rows = self.surface.faces[source]  # (M, corner, source corner)
        same = self.surface.weld[rows] == corners[:, :, None]
        known = same.any(axis=2)
        original = np.where(known, np.take_along_axis(rows, same.argmax(axis=2)[..., None], axis=2)[..., 0], -1)
        return SurfaceEdit(
            keep=self._alive.copy(),
            vertex=corners,
            position=self.points[corners],
            source_face=source[:, 0],
            corner_face=source,
            barycentric=np.where(known[..., None], same.astype(np.float64), self._weights(corners, source)),
            original=original,
            tilt=self._tilts.rows[corners],
            kind=self._new_kind[living],
            mark=self._new_mark[living],
        )


def _meet(low: Float, high: Float, from_low: Float, to_high: Float) -> Bool:
    """(N,) boxes ``low``-``high`` (N, 3 each) that meet one box ((3,) each)."""
    result = np.ones(len(low), dtype=bool)
    for axis in range(3):  # a reduction over so short an axis would be slow
        result &= (high[:, axis] >= from_low[axis]) & (low[:, axis] <= to_high[axis])
    return result


def _bounds(points: Float, corners: Int) -> tuple[Float, Float]:
    """(K, 3) lowest and highest coordinates of (K, 3) ``corners``; a reduction over so short an axis would be slow."""
    a, b, c = (points[corners[:, k]] for k in range(3))
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
