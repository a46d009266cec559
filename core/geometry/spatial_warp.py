"""The queries of :mod:`core.geometry.spatial` in NVIDIA warp: on a CUDA device, or by the same kernels on the CPU.

Warp's hierarchies are float32 and give candidate triangles only; the nearest and the first hit among these are
decided in float64, so that results are as exact as the CPU's.
"""

from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.errors import ErrorCode, MeshmarkError
from core.geometry import warp_kernels
from core.geometry.spatial import Eye, SpatialIndex

wp.config.log_level = wp.LOG_WARNING  # no banner, and no line for each kernel that is compiled

# In extents of the mesh: many times the error of its coordinates, and of rays near it, rounded to float32.
SLACK = np.float32(2e-6)


class WarpIndex(SpatialIndex):
    """A :class:`SpatialIndex` that answers on ``device``, as warp and torch name it: ``cpu``, ``cuda``."""

    def __init__(
        self,
        positions: Float,
        faces: Int,
        ids: Int | None = None,
        hides: NDArray[np.uint8] | None = None,
        device: str = "cuda",
    ) -> None:
        super().__init__(positions, faces, ids, hides)
        self.device = device
        used = self.positions[self.faces]
        self._middle = (used.min(axis=(0, 1)) + used.max(axis=(0, 1))) / 2

    @cached_property
    def _on_device(self) -> tuple[wp.Mesh, wp.Bvh, Any]:
        """At unit extent: the mesh for closest points, the hierarchy of bounding boxes, and all corners.

        Raises:
            MeshmarkError: ``device_unavailable`` where the compiled kernels cannot be kept.
        """
        try:
            wp.load_module(warp_kernels, device=self.device)
        except OSError as error:
            raise MeshmarkError(
                ErrorCode.DEVICE_UNAVAILABLE,
                f"What is compiled for the device cannot be kept ({error}).",
                "Name a folder that can be written in WARP_CACHE_PATH, or set MESHMARK_DEVICE=cpu.",
            ) from error
        inwards = self._inwards(self.positions)
        with np.errstate(over="ignore"):  # of vertices that no face has: those of faces are at most 1
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
        wp.launch(warp_kernels.closest, len(points), given, [nearest, faces], device=self.device)
        found = nearest.numpy() * self._built.extent + self._middle
        return np.linalg.norm(found - points, axis=1), self._row(faces.numpy().astype(np.int64)), found

    def first_hit(self, origins: Float, directions: Float, eye: Eye | None = None) -> tuple[Float, Int]:
        """As :meth:`SpatialIndex.first_hit`."""
        if len(origins) == 0:
            return super().first_hit(origins, directions, eye)
        _, tree, corners = self._on_device
        length = np.linalg.norm(directions, axis=1)
        length[length == 0] = 1.0  # a ray without direction hits nothing
        distance, faces = self._room(origins, wp.float64), self._room(origins, wp.int32)
        start, unit = self._inwards(origins), directions / length[:, None]
        rays = self._sent(start, wp.vec3d), self._sent(unit, wp.vec3d)
        given = [tree.id, corners, *rays, SLACK, self._sent_hides(), 0 if eye is None else int(eye)]
        wp.launch(warp_kernels.first_hit, len(origins), given, [distance, faces], device=self.device)
        face = faces.numpy().astype(np.int64)
        return distance.numpy() * (self._built.extent / length), np.where(face >= 0, self._row(face), -1)

    def _sent_hides(self) -> Any:
        hides = np.zeros(len(self.faces), dtype=np.uint8) if self._hides is None else self._hides
        return self._sent(hides, wp.uint8)

    def _inwards(self, points: Float) -> Float:
        """Points in the frame in which the mesh is centred at the origin with unit extent."""
        return np.asarray((points - self._middle) / self._built.extent)

    def _sent(self, values: NDArray[Any], kind: Any) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=kind, device=self.device)

    def _room(self, asked: Float, kind: Any) -> Any:
        return wp.empty(len(asked), dtype=kind, device=self.device)
