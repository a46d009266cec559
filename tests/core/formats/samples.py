"""One small valid file of each format: a cube, or what the format can say about it."""

import base64
import io
import json
import struct
import zipfile
import zlib

from core.gltf.accessors import read_accessor
from core.gltf.document import Document
from tests.core.gltf.builder import CUBE, CUBE_FACES, simple

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

OFF_BINARY = (
    b"OFF BINARY\n"
    + struct.pack(">3i", 8, 6, 12)
    + b"".join(struct.pack(">3f", *point) for point in CUBE)
    + b"".join(struct.pack(">6i", 4, *face, 0) for face in ([0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6]))
    + struct.pack(">6i3f", 4, 0, 2, 6, 4, 3, 1.0, 0.5, 0.0)
    + struct.pack(">6i", 4, 1, 5, 7, 3, 0)
)
PLY_STRIPS = (
    b"ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    b"element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    + b"".join(b"%d %d %d\n" % tuple(point) for point in CUBE)
    + b"20 0 2 1 3 5 7 4 6 0 2 -1 2 6 3 7 -1 0 1 4 5\n"
)


def zipped(files: dict[str, bytes | str]) -> bytes:
    """A ZIP archive of named contents; the same ones give the same bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def png(red: int, green: int, blue: int, size: int = 2) -> bytes:
    """A PNG of one colour."""

    def chunk(kind: bytes, payload: bytes) -> bytes:
        return struct.pack(">I", len(payload)) + kind + payload + struct.pack(">I", zlib.crc32(kind + payload))

    header = struct.pack(">2I5B", size, size, 8, 2, 0, 0, 0)
    rows = (b"\0" + bytes((red, green, blue)) * size) * size
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def gltf(uri: str = "cube.bin", **properties: object) -> bytes:
    """The cube of the GLB as a .gltf whose buffer is in another file."""
    document = Document.from_glb(GLB)
    document.json["buffers"][0]["uri"] = uri
    return json.dumps(document.json | properties).encode()


CUBE_BIN = Document.from_glb(GLB).binary
GLTF = gltf("data:application/octet-stream;base64," + base64.b64encode(CUBE_BIN).decode())
MTL = b"newmtl paint\nKd 1 0 0\nmap_Kd -s 1 1 1 tex/paint.png\nnewmtl gold\nKd 1 0.5 0\nPm 1\nPr 0.25\nd 0.5\n"
OBJ_ZIP = zipped(
    {"cube.obj": OBJ.replace(b"../../etc/passwd", b"cube.mtl"), "cube.mtl": MTL, "tex/paint.png": png(9, 9, 9)}
)


def threemf_model(resources: str, build: str, attributes: str = 'unit="millimeter"') -> str:
    """The XML of a 3MF model part."""
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" '
        'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02" '
        'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06" '
        f"{attributes}><resources>{resources}</resources><build>{build}</build></model>"
    )


def threemf_cube(properties: str = "") -> str:
    """The mesh of a cube; ``properties`` are attributes of its first triangle."""
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in CUBE)
    triangles = "".join(
        f'<triangle v1="{CUBE_FACES[at]}" v2="{CUBE_FACES[at + 1]}" v3="{CUBE_FACES[at + 2]}" '
        f"{properties if at == 0 else ''}/>"
        for at in range(0, 36, 3)
    )
    return f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"


THREEMF = zipped(
    {
        "_rels/.rels": '<Relationships><Relationship Target="/3D/3dmodel.model" Id="a" '
        'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>',
        "3D/3dmodel.model": threemf_model(
            f'<object id="1" name="cube">{threemf_cube()}</object>', '<item objectid="1"/>'
        ),
    }
)


def dae(
    nodes: str = '<node id="n"><instance_geometry url="#g"/></node>',
    asset: str = "",
    materials: str = "",
    extra: str = "",
    symbol: str = "paint",
) -> bytes:
    """A DAE of a cube with a UV set, drawn by ``nodes``."""
    points = " ".join(str(value) for point in CUBE for value in point)
    corners = " ".join(f"{corner} {number % 3}" for number, corner in enumerate(CUBE_FACES))

    def source(name: str, values: str, columns: str) -> str:
        count = len(values.split())
        params = "".join(f'<param name="{column}" type="float"/>' for column in columns)
        return (
            f'<source id="{name}"><float_array id="{name}-a" count="{count}">{values}</float_array><technique_common>'
            f'<accessor source="#{name}-a" count="{count // len(columns)}" stride="{len(columns)}">{params}</accessor>'
            "</technique_common></source>"
        )

    return (
        '<?xml version="1.0" encoding="utf-8"?>'
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f'<asset>{asset}</asset>{materials}<library_geometries><geometry id="g" name="cube"><mesh>'
        + source("p", points, "XYZ")
        + source("t", "0 0 1 0 1 1", "ST")
        + '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        f'<triangles material="{symbol}" count="12"><input semantic="VERTEX" source="#v" offset="0"/>'
        f'<input semantic="TEXCOORD" source="#t" offset="1" set="0"/><p>{corners}</p></triangles>'
        f"</mesh></geometry></library_geometries>{extra}"
        f'<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    ).encode()


DAE = dae()

SAMPLES = {
    "glb": GLB,
    "obj": OBJ,
    "off": OFF,
    "stl-ascii": STL_ASCII,
    "stl-binary": STL_BINARY,
    "ply-ascii": PLY_ASCII,
    "ply-little-endian": ply_binary("<"),
    "ply-big-endian": ply_binary(">"),
    "ply-strips": PLY_STRIPS,
    "off-binary": OFF_BINARY,
    "gltf": GLTF,
    "gltf+zip": zipped({"a/cube.gltf": gltf("cube.bin"), "a/cube.bin": CUBE_BIN}),
    "obj+zip": OBJ_ZIP,
    "3mf": THREEMF,
    "dae": DAE,
    "dae+zip": zipped({"cube.dae": DAE}),
    "glb+zip": zipped({"a/cube.glb": GLB, "a/LICENSE.txt": "CC0", "a/preview.png": png(9, 9, 9)}),
    "ply+zip": zipped({"cube.ply": PLY_ASCII, "readme.md": "a cube"}),
    "3mf+zip": zipped({"cube.3mf": THREEMF, "license": "CC0"}),
    "off+zip": zipped({"cube.off": OFF, "preview.jpg": "x"}),
    "stl+zip": zipped({"files/Cube.STL": STL_BINARY, "LICENSE.txt": "CC0", "images/cube.png": png(9, 9, 9)}),
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
