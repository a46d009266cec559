"""Any accepted file as plain geometry: materials, textures and nodes are what an attacker does not mind losing."""

from dataclasses import replace

from core.formats.admission import admit, document_of
from core.geometry.surface import Surface
from core.gltf.scene import flatten
from core.lab.plain import plain


def read_plain(data: bytes) -> Surface:
    """The asset's triangles in its own size-30 frame, welded where vertices are exactly equal.

    Raises:
        MeshmarkError: whatever :func:`core.formats.admission.admit` and the loaders refuse.
    """
    surface = flatten(document_of(admit(data))).surface
    return replace(plain(surface).surface(), scale=surface.scale, offset=surface.offset)
