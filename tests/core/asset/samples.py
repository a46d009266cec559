"""One small valid file of each format: a cube, or what the format can say about it."""

import struct

from core.asset.gltf import Document, read_accessor
from tests.core.asset.builder import CUBE, CUBE_FACES, simple

OBJ = (
    b"# a comment\nmtllib ../../etc/passwd\no cube\n"
    + b"".join(b"v %d %d %d\n" % tuple(point) for point in CUBE)
    + b"vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\nvn 0 0 -1\nusemtl paint\ns off\n"
    b"f 1/1/1 5/2/1 6/3/1 2/4/1\nf 3//2 4//2 8//2 7//2\nf 1/1 2/2 4/3 3/4\nf -4 -2 -1 -3\n"
    b"usemtl gold\nf 1 3 7\nf 1 7 5\nf 2 6 8\nf 2 8 4\n"
)
OFF = (
    b"OFF # a cube\n8 6 12\n"
    + b"".join(b"%d %d %d\n" % tuple(point) for point in CUBE)
    + b"4 0 1 3 2 255 0 0\n4 4 6 7 5 0 255 0\n4 0 4 5 1\n4 2 3 7 6\n4 0 2 6 4\n4 1 5 7 3\n"
)
STL_BINARY = (
    b"solid but binary".ljust(80)
    + struct.pack("<I", 12)
    + b"".join(
        struct.pack("<12fH", 0, 0, 0, *(value for corner in CUBE_FACES[at : at + 3] for value in CUBE[corner]), 0)
        for at in range(0, 36, 3)
    )
)
STL_ASCII = (
    b"solid cube\n"
    + b"".join(
        b" facet normal 0 0 0\n  outer loop\n"
        + b"".join(b"   vertex %g %g %g\n" % tuple(CUBE[corner]) for corner in CUBE_FACES[at : at + 3])
        + b"  endloop\n endfacet\n"
        for at in range(0, 36, 3)
    )
    + b"endsolid cube\n"
)
_PLY_HEADER = (
    b"ply\nformat %s 1.0\ncomment a cube\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    b"property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 7\n"
    b"property list uchar int vertex_indices\nend_header\n"
)
# five quads and two triangles
_POLYGONS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7], [1, 7, 3]]
PLY_ASCII = (
    _PLY_HEADER % b"ascii"
    + b"".join(b"%d %d %d 255 128 0\n" % tuple(point) for point in CUBE)
    + b"".join(b"%d %s\n" % (len(face), b" ".join(b"%d" % corner for corner in face)) for face in _POLYGONS)
)


def ply_binary(order: str) -> bytes:
    """The same PLY in binary; ``order`` is "<" or ">"."""
    name = {"<": b"binary_little_endian", ">": b"binary_big_endian"}[order]
    vertices = b"".join(struct.pack(order + "3f3B", *point, 255, 128, 0) for point in CUBE)
    faces = b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in _POLYGONS)
    return _PLY_HEADER % name + vertices + faces


GLB = simple(CUBE, CUBE_FACES).to_glb()

SAMPLES = {
    "glb": GLB,
    "obj": OBJ,
    "off": OFF,
    "stl-ascii": STL_ASCII,
    "stl-binary": STL_BINARY,
    "ply-ascii": PLY_ASCII,
    "ply-little-endian": ply_binary("<"),
    "ply-big-endian": ply_binary(">"),
}


def triangle_count(document: Document) -> int:
    """Triangles of all primitives, each an indexed list or a plain one."""
    return sum(
        document.json["accessors"][primitive.get("indices", primitive["attributes"]["POSITION"])]["count"] // 3
        for mesh in document.json["meshes"]
        for primitive in mesh["primitives"]
    )


def triangle_points(document: Document, primitive: int = 0) -> list[list[list[float]]]:
    """(T, 3, 3) corner positions of a primitive of the first mesh."""
    entry = document.json["meshes"][0]["primitives"][primitive]
    points = read_accessor(document, entry["attributes"]["POSITION"])
    corners: list[list[list[float]]] = points[read_accessor(document, entry["indices"]).reshape(-1, 3)].tolist()
    return corners
