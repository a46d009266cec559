"""Subdivision at the edges' midpoints (paper, supplement "More Attacks Analysis")."""

import numpy as np

from core.errors import ErrorCode, MeshmarkError
from core.geometry.edges import edge_table
from core.lab.attacks.target import Attacked, Target, whole
from core.lab.plain import Mesh

MAX_FACES = 5_000_000  # faces, as many as an asset may have at intake


def subdivide(mesh: Mesh, target: Target, strength: float = 2) -> Attacked:
    """Splits every triangle into four at its edges' midpoints; the surface stays as it is, its vertices do not.

    Args:
        mesh: the watermarked mesh.
        target: unused but for the watermarks' number.
        strength: rounds, rounded to a whole number; each multiplies the faces by four.

    Raises:
        MeshmarkError: ``budget_exceeded`` if the result would have more than 5,000,000 faces.
    """
    rounds = round(strength)
    if len(mesh.faces) * 4**rounds > MAX_FACES:
        raise MeshmarkError(
            ErrorCode.BUDGET_EXCEEDED,
            f"{rounds} rounds of subdivision would turn the {len(mesh.faces)} faces of this file into "
            f"{len(mesh.faces) * 4**rounds}; at most {MAX_FACES} are made.",
            "Lower the strength or decimate the file first.",
        )
    for _ in range(rounds):
        mesh = _halve(mesh)
    return whole(mesh, target)


def _halve(mesh: Mesh) -> Mesh:
    count, width = len(mesh.faces), len(mesh.positions)
    edges = edge_table(mesh.faces)
    middle = mesh.positions[edges.ends].mean(axis=1)
    a, b, c = mesh.faces.T
    ab, bc, ca = (edges.edge + width).reshape(count, 3).T
    faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    return Mesh(np.concatenate([mesh.positions, middle]), faces)
