"""Any accepted file as plain geometry, without materials, textures and nodes, as an attacker may leave it."""

from dataclasses import replace

from core.formats.admission import admit, document_of
from core.geometry.surface import Surface
from core.gltf.scene import flatten
from core.lab.plain import plain


def read_plain(data: bytes) -> Surface:
    """The asset's triangles in its own size-30 frame, welded where vertices are exactly equal.

    Raises:
        MeshmarkError: as :func:`core.formats.admission.admit` and the loaders.
    """
    surface = flatten(document_of(admit(data))).surface
    return replace(plain(surface).surface(), scale=surface.scale, offset=surface.offset)
