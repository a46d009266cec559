"""A mesh and nothing else, for baselines and attacks, which use neither textures nor nodes."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Bool, Float, Int
from core.formats.assemble import assemble
from core.formats.assembly import Assembly, Instance
from core.formats.polygons import Material, PolygonMesh
from core.geometry.surface import Surface
from core.gltf.colors import hex_linear

GREY = Material("surface", (0.8, 0.8, 0.8, 1.0))


@dataclass(frozen=True, eq=False)
class Mesh:
    """Indexed triangles; vertices that several faces share are one row.

    Attributes:
        positions: (V, 3) float64, in the size-30 frame of the original asset unless a function says otherwise.
        faces: (F, 3) int64 into ``positions``.
    """

    positions: Float
    faces: Int

    def surface(self) -> Surface:
        """The mesh as the working surface the metrics measure, in its own coordinates (scale 1, offset 0)."""
        count = len(self.faces)
        return Surface(
            positions=self.positions,
            faces=self.faces,
            weld=np.arange(len(self.positions)),
            face_primitive=np.zeros(count, np.int64),
            face_triangle=np.arange(count),
            scale=1.0,
            offset=np.zeros(3),
        )


def plain(surface: Surface) -> Mesh:
    """The triangles of ``surface``, its welded vertices merged and unused ones left out; faces keep their order.

    Faces that the weld collapses to a line or a point stay, so that faces of both correspond.
    """
    _, first, label = np.unique(surface.weld, return_index=True, return_inverse=True)
    return compact(Mesh(surface.positions[first], label[surface.faces]))


def compact(mesh: Mesh) -> Mesh:
    """The mesh without the vertices that no face uses."""
    used = np.zeros(len(mesh.positions), dtype=bool)
    used[mesh.faces] = True
    return Mesh(mesh.positions[used], (np.cumsum(used) - 1)[mesh.faces])


def plain_glb(
    mesh: Mesh, letters: Bool | None = None, color: str | None = None, double_sided: bool | None = None
) -> bytes:
    """A GLB of one grey mesh without normals, which is drawn with flat shading.

    Args:
        mesh: to be written.
        letters: (F,) the faces that get ``color``.
        color: ``"#rrggbb"``; None leaves all faces grey.
        double_sided: whether back faces are drawn; None draws those of open meshes, as in files whose format does not
            say.

    Raises:
        MeshmarkError: ``no_faces``.
    """
    painted = letters if letters is not None and color is not None else np.zeros(len(mesh.faces), dtype=bool)
    materials = [GREY]
    if color is not None:
        red, green, blue = hex_linear(color).tolist()
        materials.append(Material("letters", (red, green, blue, 1.0)))
    body = PolygonMesh(
        positions=mesh.positions,
        corners=mesh.faces.ravel(),
        sizes=np.full(len(mesh.faces), 3),
        group=painted.astype(np.int64),
        materials=tuple(materials),
    )
    document = assemble(Assembly([body], ["model"], [Instance("model", 0)]))
    if double_sided is not None:
        for material in document.json["materials"]:
            material["doubleSided"] = double_sided
    return document.to_glb()
