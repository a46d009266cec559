"""The same questions as :mod:`core.spatial`, answered by NVIDIA warp: on a CUDA device, or by the same kernels on the
CPU.

Warp's hierarchies are float32. They only say which triangles are in question; what is nearest and what is hit is
decided between those in float64, so that answers are as exact as the CPU's.
"""

from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from core.errors import ErrorCode, MeshmarkError
from core.spatial import SpatialIndex

Float = NDArray[np.float64]
Int = NDArray[np.int64]

wp.config.log_level = wp.LOG_WARNING  # no banner, and no line for each kernel that is compiled

# Of a mesh of unit extent; rounding to float32 moves no coordinate of it, nor of a query, by a tenth of that.
SLACK = np.float32(2e-6)
# Barycentric: rays along the edge between two triangles must not slip through for rounding.
EDGE = wp.constant(wp.float64(1e-12))
FAR = wp.constant(wp.float32(1e18))  # its square is still a float32


@wp.func
def _on_segment(a: wp.vec3d, b: wp.vec3d, point: wp.vec3d) -> wp.vec3d:
    along = b - a
    squared = wp.dot(along, along)
    share = wp.float64(0.0)
    if squared > wp.float64(0.0):
        share = wp.clamp(wp.dot(point - a, along) / squared, wp.float64(0.0), wp.float64(1.0))
    return a + along * share


@wp.func
def _nearer(a: wp.vec3d, b: wp.vec3d, point: wp.vec3d) -> wp.vec3d:
    if wp.length_sq(a - point) < wp.length_sq(b - point):
        return a
    return b


@wp.func
def _on_triangle(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, point: wp.vec3d) -> wp.vec3d:
    """The point's foot on the plane where that is inside, else the nearest on an edge; a sliver is its edges."""
    foot = _nearer(_on_segment(a, b, point), _on_segment(b, c, point), point)
    foot = _nearer(_on_segment(c, a, point), foot, point)
    normal = wp.cross(b - a, c - a)
    squared = wp.dot(normal, normal)
    if squared > wp.float64(0.0):
        v = wp.dot(wp.cross(point - a, c - a), normal) / squared
        w = wp.dot(wp.cross(b - a, point - a), normal) / squared
        if v >= wp.float64(0.0) and w >= wp.float64(0.0) and v + w <= wp.float64(1.0):
            foot = _nearer(a + (b - a) * v + (c - a) * w, foot, point)
    return foot


@wp.func
def _single(vector: wp.vec3d) -> wp.vec3f:
    return wp.vec3f(wp.float32(vector[0]), wp.float32(vector[1]), wp.float32(vector[2]))


@wp.kernel
def _closest(
    mesh: wp.uint64,
    tree: wp.uint64,
    corners: wp.array2d[wp.vec3d],
    points: wp.array[wp.vec3d],
    slack: wp.float32,
    nearest: wp.array[wp.vec3d],
    faces: wp.array[wp.int32],
):
    """Of the triangles that reach into the sphere to the nearest one that float32 finds, the nearest one."""
    i = wp.tid()
    point = points[i]
    face = wp.int32(0)  # warp passes slivers over; where there is nothing else, any triangle gives the sphere
    rough = wp.mesh_query_point_no_sign(mesh, _single(point), FAR)
    if rough.result:
        face = rough.face
    best = _on_triangle(corners[face, 0], corners[face, 1], corners[face, 2], point)
    radius = wp.float32(wp.length(best - point))
    query = wp.bvh_query_sphere(tree, _single(point), radius + (radius + wp.float32(1.0)) * slack)
    other = wp.int32(0)
    while wp.bvh_query_next(query, other):
        foot = _on_triangle(corners[other, 0], corners[other, 1], corners[other, 2], point)
        difference = wp.length_sq(foot - point) - wp.length_sq(best - point)
        # Among equals the first, so that the answer does not depend on the order in which the tree is walked.
        if difference < wp.float64(0.0) or (difference == wp.float64(0.0) and other < face):
            best = foot
            face = other
    nearest[i] = best
    faces[i] = face


@wp.kernel
def _first_hit(
    tree: wp.uint64,
    corners: wp.array2d[wp.vec3d],
    origins: wp.array[wp.vec3d],
    directions: wp.array[wp.vec3d],
    slack: wp.float32,
    distances: wp.array[wp.float64],
    faces: wp.array[wp.int32],
):
    """Moeller and Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997; ``directions`` have length 1."""
    i = wp.tid()
    origin = origins[i]
    direction = directions[i]
    face = wp.int32(-1)
    best = wp.float64(wp.inf)
    # From where the ray comes near the mesh: float32 is too coarse for an origin far away.
    skipped = wp.max(-wp.dot(origin, direction) - wp.float64(2.0), wp.float64(0.0))
    reach = wp.float32(wp.inf)
    query = wp.bvh_query_ray(tree, _single(origin + direction * skipped), _single(direction))
    other = wp.int32(0)
    while wp.bvh_query_next(query, other, reach):
        a = corners[other, 0]
        ab = corners[other, 1] - a
        ac = corners[other, 2] - a
        across = wp.cross(direction, ac)
        volume = wp.dot(ab, across)
        if volume != wp.float64(0.0):
            offset = origin - a
            v = wp.dot(offset, across) / volume
            around = wp.cross(offset, ab)
            w = wp.dot(direction, around) / volume
            distance = wp.dot(ac, around) / volume
            inside = v >= -EDGE and w >= -EDGE and v + w <= wp.float64(1.0) + EDGE
            nearer = distance < best or (distance == best and other < face)
            if inside and distance >= wp.float64(0.0) and nearer:
                best = distance
                face = other
                reach = wp.float32(distance - skipped) + wp.float32(4.0) * slack
    distances[i] = best
    faces[i] = face


class WarpIndex(SpatialIndex):
    """A :class:`SpatialIndex` that answers on ``device``, as warp and torch name it: ``cpu``, ``cuda``."""

    def __init__(self, positions: Float, faces: Int, ids: Int | None = None, device: str = "cuda") -> None:
        super().__init__(positions, faces, ids)
        self.device = device
        used = self.positions[self.faces]
        low, high = used.min(axis=(0, 1)), used.max(axis=(0, 1))
        self._middle = (low + high) / 2
        self._extent = float((high - low).max()) or 1.0

    @cached_property
    def _on_device(self) -> tuple[wp.Mesh, wp.Bvh, Any]:
        """At unit extent: what finds a triangle nearby, what finds all whose boxes are near, and all their corners.

        Raises:
            MeshmarkError: ``device_unavailable`` where the compiled kernels cannot be kept.
        """
        try:
            wp.load_module(__name__, device=self.device)
        except OSError as error:
            raise MeshmarkError(
                ErrorCode.DEVICE_UNAVAILABLE,
                f"What is compiled for the device cannot be kept ({error}).",
                "Name a folder that can be written in WARP_CACHE_PATH, or set MESHMARK_DEVICE=cpu.",
            ) from error
        inwards = self._inwards(self.positions)
        corners, single = inwards[self.faces], inwards.astype(np.float32)
        low, high = single[self.faces].min(axis=1) - SLACK, single[self.faces].max(axis=1) + SLACK
        mesh = wp.Mesh(self._sent(single, wp.vec3f), self._sent(self.faces.astype(np.int32).ravel(), wp.int32))
        return mesh, wp.Bvh(self._sent(low, wp.vec3f), self._sent(high, wp.vec3f)), self._sent(corners, wp.vec3d)

    def closest(self, points: Float) -> tuple[Float, Int, Float]:
        """As :meth:`SpatialIndex.closest`."""
        if len(points) == 0:
            return super().closest(points)
        mesh, tree, corners = self._on_device
        nearest, faces = self._room(points, wp.vec3d), self._room(points, wp.int32)
        inwards = self._sent(self._inwards(points), wp.vec3d)
        given = [mesh.id, tree.id, corners, inwards, SLACK]
        wp.launch(_closest, len(points), given, [nearest, faces], device=self.device)
        found = nearest.numpy() * self._extent + self._middle
        return np.linalg.norm(found - points, axis=1), self._row(faces.numpy().astype(np.int64)), found

    def first_hit(self, origins: Float, directions: Float) -> tuple[Float, Int]:
        """As :meth:`SpatialIndex.first_hit`."""
        if len(origins) == 0:
            return super().first_hit(origins, directions)
        _, tree, corners = self._on_device
        length = np.linalg.norm(directions, axis=1)
        length[length == 0] = 1.0  # such a ray goes nowhere and meets nothing
        distance, faces = self._room(origins, wp.float64), self._room(origins, wp.int32)
        start, unit = self._inwards(origins), directions / length[:, None]
        given = [tree.id, corners, self._sent(start, wp.vec3d), self._sent(unit, wp.vec3d), SLACK]
        wp.launch(_first_hit, len(origins), given, [distance, faces], device=self.device)
        face = faces.numpy().astype(np.int64)
        return distance.numpy() * (self._extent / length), np.where(face >= 0, self._row(face), -1)

    def _inwards(self, points: Float) -> Float:
        """Into the frame in which the mesh lies about the origin with unit extent."""
        return (np.asarray(points, dtype=np.float64) - self._middle) / self._extent

    def _sent(self, values: NDArray[Any], kind: Any) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=kind, device=self.device)

    def _room(self, asked: Float, kind: Any) -> Any:
        return wp.empty(len(asked), dtype=kind, device=self.device)
