"""Small surfaces whose every property is known by hand."""

from itertools import pairwise

import numpy as np
import trimesh

from core.arrays import Float, Int
from core.geometry.surface import Surface


def surface(positions: Float, faces: Int) -> Surface:
    """A surface whose coordinates are taken as size-30 ones already; equal positions are welded."""
    _, weld = np.unique(positions, axis=0, return_inverse=True)
    return Surface(
        positions=np.asarray(positions, dtype=np.float64),
        faces=np.asarray(faces, dtype=np.int64),
        weld=weld.ravel().astype(np.int64),
        face_primitive=np.zeros(len(faces), dtype=np.int64),
        face_triangle=np.arange(len(faces)),
        scale=1.0,
        offset=np.zeros(3),
    )


def grid(width: float, height: float, columns: int, rows: int) -> Surface:
    """A flat sheet in the plane z = 0, facing +z, centred at the origin."""
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, columns + 1), np.linspace(-height / 2, height / 2, rows + 1))
    positions = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    right, up = corner + 1, corner + columns + 1
    faces = np.concatenate([np.column_stack([corner, right, up + 1]), np.column_stack([corner, up + 1, up])])
    return surface(positions, faces)


def box(*size: float) -> Surface:
    """A closed box of 12 triangles, centred at the origin."""
    mesh = trimesh.creation.box(extents=size)
    return surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def sphere(radius: float, subdivisions: int = 5) -> Surface:
    """A closed sphere of 20 * 4**subdivisions triangles."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def join(*parts: Surface) -> Surface:
    """Several surfaces as one, welded where their vertices coincide."""
    start = np.concatenate([[0], np.cumsum([len(part.positions) for part in parts])])
    return surface(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.faces + first for part, (first, _) in zip(parts, pairwise(start), strict=True)]),
    )


def moved(part: Surface, *by: float) -> Surface:
    """The surface moved by a vector."""
    return surface(part.positions + np.array(by), part.faces)


def edge_counts(faces: Int) -> tuple[int, int]:
    """How many edges have one face, and how many have more than two."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return int(np.sum(counts == 1)), int(np.sum(counts > 2))
