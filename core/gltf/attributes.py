"""Vertex attributes at points inside triangles, interpolated for the corners of new triangles."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bool, Float, Int
from core.geometry.products import cross, length
from core.geometry.triangles import unit
from core.gltf.accessors import dequantize, read_accessor, read_values
from core.gltf.document import Document
from core.gltf.skin import influence_sets, merge, quantize_weights, read_influences

# Always written as floats: integers would round new rows visibly, or off the surface.
GEOMETRIC = ("POSITION", "NORMAL", "TANGENT")


@dataclass(frozen=True, eq=False)
class Points:
    """C points, each inside a triangle of accessor rows.

    Attributes:
        rows: (C, 3) int64 accessor rows of the triangle.
        barycentric: (C, 3) float64.
    """

    rows: Int
    barycentric: Float

    def __getitem__(self, index: Int | Bool) -> "Points":
        return Points(self.rows[index], self.barycentric[index])

    def interpolate(self, values: Float) -> Float:
        """(C, n) values at the points from (V, n) values at the accessor rows."""
        return np.asarray(np.einsum("ck,ckn->cn", self.barycentric, values[self.rows]))

    def nearest(self, values: NDArray[Any]) -> NDArray[Any]:
        """(C, n) values of the triangle corner of the largest barycentric coordinate at each point."""
        strongest = self.barycentric.argmax(axis=1)
        return np.asarray(values[self.rows[np.arange(len(self.rows)), strongest]])


def read_rows(document: Document, name: str, accessor: int) -> NDArray[Any]:
    """(V, n) accessor rows in the component type that they are written in: see ``GEOMETRIC``."""
    rows = read_values(document, accessor).astype("<f4") if name in GEOMETRIC else read_accessor(document, accessor)
    return rows.reshape(len(rows), -1)


def interpolate_attribute(document: Document, name: str, accessor: int, points: Points) -> Float:
    """(C, n) float64 values of an attribute or a morph target's change of it.

    UV sets, colours and all other quantities are linear in the triangle. A lifted corner takes the value of its foot
    point (:attr:`core.gltf.edit.SurfaceEdit.barycentric`). Integer identifiers (of features and the like) are those of
    the nearest corner.
    """
    rows = read_accessor(document, accessor)
    rows = rows.reshape(len(rows), -1)
    entry = document.entry("accessors", accessor)
    is_name = rows.dtype.kind in "iu" and not entry.get("normalized", False)
    if name.startswith(("_FEATURE_ID", "JOINTS_")) or (name.startswith("_") and is_name):
        return points.nearest(rows).astype(np.float64)
    return points.interpolate(dequantize(rows, entry))


def encode(values: Float, dtype: np.dtype[Any], normalized: bool) -> NDArray[Any]:
    """Float values in an accessor's component type: the inverse of :func:`~core.gltf.document.dequantize`, rounded."""
    if dtype.kind == "f":
        return np.asarray(values, dtype)
    limits = np.iinfo(dtype)
    scaled = np.round(values * limits.max) if normalized else np.round(values)
    return np.asarray(np.clip(scaled, limits.min, limits.max), dtype)


def interpolate_influences(document: Document, attributes: dict[str, Any], points: Points) -> tuple[Int, Float]:
    """Joints (C, K) and weights (C, K), K = 4 per set, exactly as they are written.

    The influences of the three corners are merged, weighted by the barycentric coordinates, and the strongest K
    are kept. The weights are rounded to the coarsest component type of the primitive's sets, in which they sum to
    exactly 1, so that every set can hold its share without further rounding.
    """
    joints, weights = read_influences(document, attributes)
    shares = points.barycentric[:, :, None] * weights[points.rows]
    spread = joints[points.rows].reshape(len(points.rows), -1)
    merged, strongest = merge(spread, shares.reshape(len(points.rows), -1), keep=joints.shape[1])
    dtypes = [read_accessor(document, attributes[f"WEIGHTS_{n}"]).dtype for n in range(influence_sets(attributes))]
    stored = quantize_weights(strongest, min(dtypes, key=lambda dtype: dtype.itemsize))
    fractions = dequantize(stored, {"normalized": True})
    return np.where(fractions > 0, merged, 0), fractions


def orthogonal_tangents(tangents: Float, normals: Float) -> Float:
    """(N, 3) unit tangents made orthogonal to unit ``normals``; any orthogonal direction where nothing is left."""
    projected = tangents - normals * np.einsum("ni,ni->n", tangents, normals)[:, None]
    lost = np.flatnonzero(length(projected) < 1e-6)
    axis = np.eye(3)[np.abs(normals[lost]).argmin(axis=1)]
    projected[lost] = cross(normals[lost], axis)
    return unit(projected)
