"""Removal: delete the faces of the watermarks (paper, section 5.4)."""

from core.errors import ErrorCode, MeshmarkError
from core.lab.attacks.target import Attacked, Target, letter_faces, whole
from core.lab.plain import Mesh, compact


def removal(mesh: Mesh, target: Target, strength: float = 1.0) -> Attacked:
    """Deletes the faces of the letters, for an attacker with full knowledge of them.

    Where embossing replaced the surface under the letters, holes in their shape remain, and the word can be read in
    them; where letters were merely united with the asset, holes remain only where the two touched.

    Args:
        mesh: the watermarked mesh.
        target: a face is a letter's if one of its vertices stands out of ``original_index`` by more than 1e-3: see
            :func:`core.lab.attacks.target.letter_faces`.
        strength: the share of these faces that is found and deleted, in (0, 1]; the rest, drawn at random, stays.

    Raises:
        MeshmarkError: ``invalid_parameters`` if there is nothing to remove; ``no_faces`` if nothing else is there.
    """
    letters = letter_faces(mesh, target.original_index)
    if not letters.any():
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            "Every vertex of this file lies on the original's surface: there is no watermark to remove.",
            "Give the watermarked file and the original it was made from.",
        )
    if letters.all():
        raise MeshmarkError(
            ErrorCode.NO_FACES,
            "No face of this file lies on the original's surface: removing the watermarks would leave nothing.",
            "Give the original that the watermarked file was made from, in the same place and scale.",
        )
    found = letters & (target.rng.random(len(letters)) < strength)
    return whole(compact(Mesh(mesh.positions, mesh.faces[~found])), target)
