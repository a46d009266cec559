"""The errors that several formats share; the GLB has its own ``malformed`` in :mod:`core.gltf.document`."""

from core.errors import ErrorCode, MeshmarkError


def malformed(sentence: str) -> MeshmarkError:
    """The error for a file that breaks the rules of its format."""
    return MeshmarkError(ErrorCode.MALFORMED_FILE, sentence, "Open it in the program that made it and export it again.")


def truncated(sentence: str) -> MeshmarkError:
    """The error for a file that ends before what it declares."""
    return MeshmarkError(ErrorCode.TRUNCATED_FILE, sentence, "Upload the complete file again.")


def no_faces(sentence: str) -> MeshmarkError:
    """The error for a file without a surface."""
    return MeshmarkError(ErrorCode.NO_FACES, sentence, "Send a surface, not points or lines.")


def non_finite(sentence: str) -> MeshmarkError:
    """The error for positions that are not numbers."""
    return MeshmarkError(ErrorCode.NON_FINITE_POSITIONS, sentence, "Repair the mesh and export it again.")
