"""Parts of an asset without a watermark, by the share of the pictures that they fill."""

import numpy as np

from core.analysis.saliency import Saliency
from core.arrays import Float, Int
from core.geometry.directions import cosines_to_cameras, to_cameras, view_directions
from core.geometry.spatial import Eye, SpatialIndex
from core.geometry.surface import Surface
from core.gltf.scene import Scene
from core.notices import Notice, NoticeCode

STRIDE = 4  # every fourth of the surface's samples is tested for visibility
CLEAR = 0.01  # size-30 units between the surface and the origins of rays
MISSING, NAMED = 0.25, 8  # share of the visible surface without marks from which on a warning is given; parts it names
# Share of the visible surface from which on a part counts. Marks are concentrated where at most the second share of the
# parts has any, and these have the third number each in the mean: as on a stage and nothing else.
COUNTED, FEW, CONCENTRATED = 0.01, 0.25, 2


def unmarked_parts(
    scene: Scene, surface: Surface, samples: Saliency, index: SpatialIndex, marked: Int
) -> Notice | None:
    """A warning where the marks are concentrated on a few parts of many, such as a stage or the ground, and much of the
    visible surface carries none: taken apart from the asset, it is unmarked.

    Parts are the faces of each node; where there is one node only, those of each material.

    Args:
        scene: the asset.
        surface: the scene's, with normals facing outwards: see
            :attr:`core.analysis.analyse.SurfaceAnalysis.surface`.
        samples: of ``surface``, evenly.
        index: over it, for view rays.
        marked: (N,) the drawn primitive under each mark.
    """
    names = _names(scene)
    carrying = {names[number] for number in marked.tolist()}
    several = len(marked) >= CONCENTRATED * len(carrying)
    if len(set(names)) < 2 or len(carrying) > FEW * len(set(names)) or not several:  # then no ray is needed
        return None
    seen = np.bincount(
        surface.face_primitive[samples.face[::STRIDE]],
        weights=_seen(scene, surface, samples, index),
        minlength=len(scene.primitives),
    )
    shares: dict[str, float] = {}
    for name, share in zip(names, (seen / max(float(seen.sum()), np.finfo(float).tiny)).tolist(), strict=True):
        shares[name] = shares.get(name, 0.0) + share
    left = {name: share for name, share in shares.items() if name not in carrying and share > 0}
    total = sum(left.values())
    parts = sum(share >= COUNTED for share in shares.values())
    if total < MISSING or len(carrying) > FEW * parts:
        return None
    largest = sorted(left, key=lambda name: -left[name])
    named = ", ".join(f"{name} ({left[name]:.0%})" for name in largest[:NAMED])
    more = len(largest) - NAMED
    return Notice(
        NoticeCode.UNMARKED_PARTS,
        f"{total:.0%} of what is seen of this asset belongs to parts that carry no watermark: {named}"
        + (f" and {more} more." if more > 0 else "."),
        "Name what matters most under `prefer`, ask for a larger `count`, or mark these parts by themselves.",
    )


def _names(scene: Scene) -> list[str]:
    """The name in the file of each drawn primitive's part."""
    nodes = [drawn.node for drawn in scene.primitives]
    if len({node.index for node in nodes}) > 1:
        return [_shortened(node.name) or f"nodes[{node.index}]" for node in nodes]
    materials = [drawn.primitive.material for drawn in scene.primitives]
    return [
        "" if material.index is None else _shortened(material.name) or f"materials[{material.index}]"
        for material in materials
    ]


def _shortened(name: str) -> str:
    return repr(name[:60]) if name else ""


def _seen(scene: Scene, surface: Surface, samples: Saliency, index: SpatialIndex) -> Float:
    """(S,) relative area in the paper's views of the surface around each sample, where visible; see-through surface
    has none."""
    faces = samples.face[::STRIDE]
    points, normals, solid = samples.points[::STRIDE], surface.normals[faces], scene.viewed.opacity[faces]
    directions, _ = view_directions()
    facing = cosines_to_cameras(points, normals, directions)
    sample, view = np.nonzero(facing > 0)
    start = points[sample] + CLEAR * normals[sample]
    _, face = index.first_hit(start, to_cameras(start, directions[view]), Eye.FAR)
    weight = np.where(face < 0, facing[sample, view] * solid[sample], 0.0)
    return np.asarray(np.bincount(sample, weights=weight, minlength=len(points)), dtype=np.float64)
