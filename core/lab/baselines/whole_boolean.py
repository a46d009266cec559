"""Text fused into an asset by booleans with the whole mesh: flat (Li et al.) or curve matched (the paper)."""

import numpy as np
from manifold3d import CrossSection, Error, FillRule, Manifold, OpType

from core.arrays import Float
from core.artwork.artwork import Artwork
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.lab.baselines.solid import to_manifold, to_mesh
from core.lab.plain import Mesh


def fuse_flat(asset: Manifold, artwork: Artwork, boxes: Boxes) -> Mesh:
    """The union of ``asset`` with flat extruded text that fills each box; half of its thickness is sunk.

    Raises:
        MeshmarkError: ``not_manifold`` when the boolean fails.
    """
    return _united(asset, [text_solid(artwork, boxes, one) for one in range(len(boxes))])


def fuse_curved(
    asset: Manifold, artwork: Artwork, boxes: Boxes, surface: Surface, index: SpatialIndex, relief: float
) -> Mesh:
    """The paper's Curve Matching Fusion (supplement, Algorithm 2).

    The text of each box is intersected with the asset. The intersection has the asset's own surface as its top; this
    top is moved by ``relief``, size-30 units, along the normal of the face closest to the box's centre, and the result
    is united with the asset. The algorithm leaves the rest of "extrusion of the silhouette" open: here the bottom
    stays, so that letters of any height remain anchored, and the walls extend between. Letters that do not meet the
    asset at all are lost.

    Raises:
        MeshmarkError: ``not_manifold`` when the boolean fails.
    """
    _, face, _ = index.closest(boxes.center)
    normal = surface.normals[face]
    degenerate = np.linalg.norm(normal, axis=1) < 0.5
    normal[degenerate] = boxes.axes[degenerate, 2]
    asset = asset.as_original()  # its number distinguishes its faces from the text's
    raised = [
        _raised(asset ^ text_solid(artwork, boxes, one), asset.original_id(), relief * normal[one])
        for one in range(len(boxes))
    ]
    return _united(asset, raised)


def text_solid(artwork: Artwork, boxes: Boxes, one: int) -> Manifold:
    """The text extruded through the whole thickness of box ``one``, in place."""
    width, _, thickness = boxes.size[one]
    flat = CrossSection([width * ring for ring in artwork.rings], FillRule.Positive)
    local = flat.extrude(thickness).translate((0.0, 0.0, -thickness / 2))
    return local.transform(np.column_stack([boxes.axes[one].T, boxes.center[one]]))


def _raised(letters: Manifold, asset: int, shift: Float) -> Manifold:
    """``letters`` with those of their faces that come from the solid ``asset`` and face along ``shift`` moved by it."""
    found = letters.to_mesh64()
    ends = np.asarray(found.run_index, dtype=np.int64) // 3
    origin = np.repeat(np.asarray(found.run_original_id, dtype=np.int64), np.diff(ends))
    mesh = to_mesh(letters)
    top = mesh.faces[(origin == asset) & (mesh.surface().normals @ shift > 0)]
    moved = np.zeros(len(mesh.positions), dtype=bool)
    moved[top] = True
    return to_manifold(Mesh(mesh.positions + moved[:, None] * shift, mesh.faces))


def _united(asset: Manifold, letters: list[Manifold]) -> Mesh:
    body = Manifold.batch_boolean([asset, *letters], OpType.Add)
    if body.status() != Error.NoError:
        raise MeshmarkError(
            ErrorCode.NOT_MANIFOLD,
            f"The boolean union of the asset with its letters failed ({body.status().name}).",
            "Use a method that does not need solids.",
        )
    return to_mesh(body)
