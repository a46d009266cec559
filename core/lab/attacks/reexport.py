"""Re-export through another tool: text files and single precision."""

import trimesh

from core.lab.attacks.plain_file import read_plain
from core.lab.attacks.target import Attacked, Target, whole
from core.lab.plain import Mesh

FORMATS = ("obj", "ply", "stl")


def reexport(mesh: Mesh, target: Target, strength: float = 3) -> Attacked:
    """Writes ``mesh`` with trimesh, with its default digits, and reads the file as any upload is read.

    OBJ is text with eight decimals; PLY is binary in single precision; so is STL, each triangle with corners of its
    own, which reading welds again where they are exactly equal. Vertices come back in the file's order.

    Args:
        mesh: the watermarked mesh.
        target: unused but for the watermarks' number.
        strength: number of re-exports, through OBJ, PLY and STL in this order, rounded to 1, 2 or 3.

    Raises:
        MeshmarkError: ``no_faces``.
    """
    for name in FORMATS[: round(strength)]:
        written = trimesh.Trimesh(mesh.positions, mesh.faces, process=False).export(file_type=name)
        surface = read_plain(written if isinstance(written, bytes) else str(written).encode())
        mesh = Mesh(surface.to_world(surface.positions), surface.faces)
    return whole(mesh, target)
