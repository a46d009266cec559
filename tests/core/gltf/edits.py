"""Artificial edits: faces split at their centroid, which stays in the plane or is lifted."""

import numpy as np
from numpy.typing import ArrayLike

from core.gltf.edit import Kind, SurfaceEdit
from core.gltf.scene import Scene


def centroid_split(scene: Scene, faces: ArrayLike, kinds: list[Kind], lift: float = 0.0) -> SurfaceEdit:
    """Each of ``faces`` as three triangles of its kind around a new centroid, ``lift`` along the face normal.

    Point ids are those of the weld, so that corners at a seam are one point.
    """
    surface = scene.surface
    removed = np.asarray(faces, dtype=np.int64)
    rows = surface.faces[removed]
    corner = np.array([[0, 1, 2], [1, 2, 2], [2, 0, 2]])[:, :2]  # the two old corners of each new triangle
    source = np.repeat(removed, 3)
    old = rows[:, corner].reshape(-1, 2)
    new_id = np.repeat(surface.weld.max() + 1 + np.arange(len(removed)), 3)
    centre = surface.positions[rows].mean(axis=1) + lift * surface.normals[removed]
    position = np.concatenate([surface.positions[old], np.repeat(centre, 3, axis=0)[:, None]], axis=1)
    weights = np.concatenate([np.eye(3)[corner], np.full((3, 1, 3), 1 / 3)], axis=1)
    keep = np.ones(len(surface.faces), dtype=bool)
    keep[removed] = False
    return SurfaceEdit(
        keep=keep,
        vertex=np.column_stack([surface.weld[old], new_id]),
        position=position,
        source_face=source,
        corner_face=np.repeat(source[:, None], 3, axis=1),
        barycentric=np.tile(weights, (len(removed), 1, 1)),
        original=np.column_stack([old, np.full(len(source), -1)]),
        tilt=np.zeros_like(position),
        kind=np.repeat(np.array(kinds, dtype=np.int8), 3),
        mark=np.zeros(len(source), dtype=np.int64),
    )
