"""Every attack by its name, on a mesh and on a file."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.lab.attacks.crop import crop
from core.lab.attacks.decimate import decimate
from core.lab.attacks.noise import noise
from core.lab.attacks.plain_file import read_plain
from core.lab.attacks.reexport import reexport
from core.lab.attacks.remesh import remesh
from core.lab.attacks.removal import removal
from core.lab.attacks.rotate import rotate
from core.lab.attacks.scale import scale
from core.lab.attacks.smooth import smooth
from core.lab.attacks.subdivide import subdivide
from core.lab.attacks.target import Attacked, Target, letter_faces
from core.lab.attacks.translate import translate
from core.lab.plain import Mesh, plain_glb

__all__ = ["ATTACKS", "Attack", "Attacked", "Target", "attack_file", "letter_faces"]


@dataclass(frozen=True)
class Attack:
    """A named attack.

    Attributes:
        name: on the command line.
        function: the attack itself.
        strength: the default.
        low, high: bounds of the strength, both included.
        help: one line.
    """

    name: str
    function: Callable[[Mesh, Target, float], Attacked]
    strength: float
    low: float
    high: float
    help: str

    def __call__(self, mesh: Mesh, target: Target, strength: float | None = None) -> Attacked:
        """Attacks ``mesh``, which stays as it is.

        Raises:
            MeshmarkError: ``invalid_parameters`` for a strength out of range, ``no_faces`` if nothing is left, and
                and errors of the attack itself.
        """
        strength = self.strength if strength is None else strength
        if not self.low <= strength <= self.high:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                f"The strength of {self.name} is {strength:g}; it lies between {self.low:g} and {self.high:g}.",
                f"Leave it out for {self.strength:g}, or see what it means: {self.help}",
            )
        attacked = self.function(mesh, target, strength)
        if len(attacked.mesh.faces) == 0:
            raise MeshmarkError(
                ErrorCode.NO_FACES,
                f"Nothing is left of the {len(mesh.faces)} faces of this file after {self.name} at {strength:g}.",
                "Lower the strength.",
            )
        return attacked


ATTACKS: dict[str, Attack] = {
    attack.name: attack
    for attack in (
        Attack("crop", crop, 0.5, 0.001, 0.999, "Cut at a random plane; 0.5 is through the centroid."),
        Attack("removal", removal, 1.0, 0.01, 1.0, "Delete the letters; strength is the share of their faces."),
        Attack("remesh", remesh, 1 / 128, 1 / 512, 1 / 8, "Voxels to a new surface; strength is voxel per length."),
        Attack("decimate", decimate, 0.9, 0.001, 0.999, "Collapse edges; strength is the share of faces removed."),
        Attack("subdivide", subdivide, 2, 1, 6, "Split triangles into four; strength is the number of rounds."),
        Attack("rotate", rotate, 180, 0.001, 180, "Turn at random; strength is the largest angle in degrees."),
        Attack("translate", translate, 1, 1e-6, 1e3, "Move at random; strength is the distance in diagonals."),
        Attack("scale", scale, 10, 1.001, 1e3, "Scale at random; strength is the largest factor."),
        Attack("noise", noise, 0.001, 1e-9, 1, "Shake vertices; strength is the deviation in diagonals."),
        Attack("smooth", smooth, 10, 1, 1000, "Laplacian smoothing; strength is the number of iterations."),
        Attack("reexport", reexport, 3, 1, 3, "Write and read OBJ, PLY, STL; strength is how many of them."),
    )
}


def attack_file(data: bytes, name: str, strength: float | None, seed: int, original: bytes | None) -> bytes:
    """One attack on a file: a GLB of the attacked geometry in the units and place of the input.

    Only plain geometry comes out: no materials, textures, UVs, nodes or animations (poses are kept as drawn).

    Args:
        data: the watermarked asset in any accepted format.
        name: a key of :data:`ATTACKS`.
        strength: None for the attack's default.
        seed: of every random draw.
        original: the asset without watermarks in any accepted format; ``removal`` finds the letters by it, the other
            attacks do not use it.

    Raises:
        MeshmarkError: ``invalid_parameters`` for an unknown attack or a removal without the original; as the loaders;
            as :meth:`Attack.__call__`.
    """
    if name not in ATTACKS:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS, f'There is no attack "{name}".', f"Choose one of {', '.join(ATTACKS)}."
        )
    if name == "removal" and original is None:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            "The removal attack needs the original: letters are what lies off its surface.",
            "Give the file without watermarks too.",
        )
    surface = read_plain(data)
    unmarked = surface
    if original is not None:
        unmarked = read_plain(original)
        surface = surface.in_frame_of(unmarked)
    target = Target(
        original_index=SpatialIndex(unmarked.positions, unmarked.faces),
        boxes=Boxes.empty(),
        rng=np.random.default_rng(seed),
    )
    mesh = ATTACKS[name](Mesh(surface.positions, surface.faces), target, strength).mesh
    return plain_glb(Mesh(surface.to_world(mesh.positions), mesh.faces))
