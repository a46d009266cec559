"""The ladder of a thief who has only the marked file: from what costs him nothing to what costs the asset its shape.

For measuring in the benchmark alone: no command and no route offers these.
"""

from dataclasses import replace

import numpy as np

from core.arrays import Bool, Int
from core.lab.attacks.attack import Attack
from core.lab.attacks.fill import filled_fair, filled_flat, grown, lowered
from core.lab.attacks.letters import by_edges, by_height, by_material, by_order, by_remains
from core.lab.attacks.smooth import relaxed
from core.lab.attacks.target import Attacked, Target, whole
from core.lab.plain import Mesh

SHRINK, SWELL = 0.5, -0.53  # steps of Taubin (1995)


def restore(mesh: Mesh, target: Target, _strength: float) -> Attacked:
    """Faces next to what the file holds and does not draw, and a ring round them."""
    assert target.file is not None
    return _cut_out(mesh, target, grown(mesh.faces, by_remains(target.file, mesh), 1))


def material(mesh: Mesh, target: Target, strength: float) -> Attacked:
    """Faces of rare materials and colours, and ``strength`` rings round them, as a fair surface in the ground's
    colour."""
    assert target.file is not None
    return _smoothed(mesh, target, by_material(target.file, mesh), round(strength))


def order(mesh: Mesh, target: Target, _strength: float) -> Attacked:
    """Faces that were appended."""
    assert target.file is not None
    return _cut_out(mesh, target, by_order(target.file, mesh))


def strip(mesh: Mesh, target: Target, _strength: float) -> Attacked:
    """Small patches between sharp edges."""
    return _cut_out(mesh, target, by_edges(mesh))


def lower(mesh: Mesh, target: Target, strength: float) -> Attacked:
    """Parts that stand out, and ``strength`` rings round them, pushed to where the surface round them goes on; their
    colour stays."""
    found = grown(mesh.faces, by_height(mesh), round(strength))
    if found.all() or not found.any():
        return _left(mesh, target)
    return _result(target, lowered(mesh, found), np.arange(len(found)))


def strip_wide(mesh: Mesh, target: Target, strength: float) -> Attacked:
    """All that any of the others finds, and ``strength`` rings round it, becomes a fair surface in the ground's
    colour."""
    assert target.file is not None
    scene = target.file
    found = by_edges(mesh) | by_height(mesh) | by_material(scene, mesh) | by_order(scene, mesh)
    found |= by_remains(scene, mesh)
    return _smoothed(mesh, target, found, round(strength))


def _cut_out(mesh: Mesh, target: Target, found: Bool) -> Attacked:
    """The ``found`` faces cut out, and the holes closed flat."""
    return _left(mesh, target) if found.all() or not found.any() else _result(target, *filled_flat(mesh, found))


def _smoothed(mesh: Mesh, target: Target, found: Bool, rings: int) -> Attacked:
    """The ``found`` faces and so many rings round them as a fair surface in the ground's colour."""
    around = grown(mesh.faces, found, rings)
    if around.all() or not found.any():
        return _left(mesh, target)
    return _result(target, filled_fair(mesh, around), np.where(around, -1, np.arange(len(around))))


def _left(mesh: Mesh, target: Target) -> Attacked:
    """Nothing was found, or nothing but: the asset stays as it is."""
    return _result(target, mesh, np.arange(len(mesh.faces)))


def _result(target: Target, mesh: Mesh, source: Int) -> Attacked:
    return replace(whole(mesh, target), source=source)


def taubin(mesh: Mesh, target: Target, strength: float) -> Attacked:
    """Smoothing of the whole mesh that shrinks and swells it in turn (Taubin 1995), ``strength`` times."""
    positions = relaxed(mesh, [SHRINK, SWELL] * round(strength))
    return _result(target, Mesh(positions, mesh.faces), np.arange(len(mesh.faces)))


LADDER: dict[str, Attack] = {
    attack.name: attack
    for attack in (
        Attack("thief-restore", restore, 1, 1, 1, "Cut out what lies at vertices that the file does not draw."),
        Attack("thief-by-material", material, 2, 0, 20, "Smooth what has a rare colour, and rings round it."),
        Attack("thief-by-order", order, 1, 1, 1, "Cut out what was appended to vertices and triangles."),
        Attack("thief-strip", strip, 1, 1, 1, "Cut out small patches between sharp edges."),
        Attack("thief-lower", lower, 0, 0, 20, "Push back what stands out; strength is the rings round it."),
        Attack("thief-strip-wide", strip_wide, 3, 0, 20, "Smooth what any of these finds, and rings round it."),
        Attack("thief-smooth", taubin, 300, 1, 10_000, "Taubin smoothing of everything; strength is the steps."),
    )
}
