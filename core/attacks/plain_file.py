"""Any accepted file as plain geometry: materials, textures and nodes are what an attacker does not mind losing."""

from dataclasses import replace

from core.asset.flatten import flatten
from core.asset.formats import to_document
from core.asset.gate import admit
from core.asset.plain import plain
from core.geometry.surface import Surface


def read_plain(data: bytes) -> Surface:
    """The asset's triangles in its own size-30 frame, welded where vertices are exactly equal.

    Raises:
        MeshmarkError: whatever :func:`core.asset.gate.admit` and the loaders refuse.
    """
    surface = flatten(to_document(data, admit(data))).surface
    return replace(plain(surface).surface(), scale=surface.scale, offset=surface.offset)
