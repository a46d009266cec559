"""Budgets of an asset: bounds of its declarations, before anything is allocated for it."""

from dataclasses import dataclass

from core.errors import ErrorCode, MeshmarkError


@dataclass(frozen=True)
class Budgets:
    """Upper bounds of one asset.

    Attributes:
        faces: triangles drawn; a mesh drawn by several nodes counts once per node.
        vertices: vertices drawn, counted likewise.
        draws: mesh primitives drawn, counted likewise; each costs time of its own, however small it is.
        bytes: of the file, and of all values its accessors declare.
        image_pixels: pixels of all textures together (the default is sixteen of 4096 x 4096).
        json_bytes: of the JSON chunk of a GLB.
        json_values: JSON arrays and objects in that chunk; an empty one costs 20 times its text in memory.
        polygon_corners: corners of one polygon; cutting a concave one into triangles takes time with their square.
        materials: material groups of an OBJ, each of which becomes a primitive.
        archive_entries: files and folders in a ZIP archive.
        archive_ratio: unpacked size of an archive's entry over its packed one; models reach 20.
        unpacked_bytes: of all entries of an archive together, unpacked.
        xml_depth: nesting depth of the elements of a 3MF or DAE.
        xml_elements: of all XML parts of a file together, beside the vertices and triangles of a 3MF; an empty one
            costs a hundred times as much time as its text.
        xml_attributes: of these elements together.
        element_attributes: of one element.
        xml_tag_bytes: of one tag, comment or instruction, which the parser holds whole.
        nodes: nodes that draw something in a 3MF or DAE, instances of instances included.
    """

    faces: int = 5_000_000
    vertices: int = 15_000_000
    draws: int = 100_000
    bytes: int = 200 * 2**20
    image_pixels: int = 2**28
    json_bytes: int = 16 * 2**20
    json_values: int = 500_000
    polygon_corners: int = 10_000
    materials: int = 4096
    archive_entries: int = 4096
    archive_ratio: int = 100
    unpacked_bytes: int = 512 * 2**20
    xml_depth: int = 64
    xml_elements: int = 2_000_000
    xml_attributes: int = 4_000_000
    element_attributes: int = 256
    xml_tag_bytes: int = 2**20
    nodes: int = 100_000


DEFAULT_BUDGETS = Budgets()


def within(count: int, budget: int, what: str) -> None:
    """Refuse ``count`` of ``what`` (a plural noun) above ``budget``.

    Raises:
        MeshmarkError: ``budget_exceeded``, naming both numbers.
    """
    if count > budget:
        raise MeshmarkError(
            ErrorCode.BUDGET_EXCEEDED,
            f"The file declares {count:,} {what}; at most {budget:,} are accepted.",
            "Simplify or split the asset and send it again.",
        )
