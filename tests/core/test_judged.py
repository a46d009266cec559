"""Of every kind of file: the result holds nothing of what it no longer draws, gives nothing away, and a viewer draws
every mark that is reported."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from core.choices import Evaluate, Mode
from core.formats.admission import admit, document_of
from core.gltf.document import Document
from core.parameters import Parameters
from core.pipeline import Result, watermark
from tests.core.formats.samples import SAMPLES
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder, grid, simple
from tests.core.gltf.compressed import draco, instanced, meshopted
from tests.core.gltf.rich import rich
from tests.core.shapes import sphere
from tests.drawn import undrawn
from tests.glb_file import Json
from tests.residue import residue
from tests.restore import gives, telltale_names

ASKED = Parameters(text="HOLD", count=3, size=2.0, evaluate=Evaluate.NONE)
POINTS, FACES = grid(12)
BALL = sphere(1.0, 3)
OFFSETS = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0]])
INWARDS = np.array(CUBE_FACES).reshape(-1, 3)[:, ::-1].ravel()


def ball(**material: object) -> Document:
    """With normals and texture coordinates."""
    builder = Builder()
    attributes = {
        "NORMAL": builder.accessor(BALL.positions),
        "TEXCOORD_0": builder.accessor(BALL.positions[:, :2] / 2 + 0.5),
    }
    primitive = builder.primitive(BALL.positions, BALL.faces, **attributes)
    if not material:
        return builder.document(meshes=[{"primitives": [primitive]}])
    return builder.document(meshes=[{"primitives": [{**primitive, "material": 0}]}], materials=[material])


def quantised() -> Document:
    """Bytes and shorts with padded strides, brought back to size by the node."""
    builder = Builder()
    rows = np.rint(BALL.positions * 32_000).astype("<i2")
    normals = np.rint(BALL.positions * 127).astype("<i1")
    attributes = {
        "POSITION": builder.accessor(rows, "<i2", normalized=True),
        "NORMAL": builder.accessor(normals, "<i1", normalized=True),
    }
    primitive = {"attributes": attributes, "indices": builder.accessor(BALL.faces.ravel(), "<u2")}
    return builder.document(
        meshes=[{"primitives": [primitive]}],
        nodes=[{"mesh": 0, "scale": [5, 5, 5]}],
        extensionsUsed=["KHR_mesh_quantization"],
        extensionsRequired=["KHR_mesh_quantization"],
    )


def interleaved() -> Document:
    """Positions, normals and colours of each vertex side by side, and rows of two meshes in one buffer view."""
    builder = Builder()
    ours = np.hstack([BALL.positions, BALL.positions]).astype("<f4")
    rows = np.vstack([ours, ours + np.array([4, 0, 0, 0, 0, 0], "<f4")])
    colors = np.full((len(rows), 4), 255, "u1")
    view = builder.view(np.hstack([rows.view("u1"), colors]).tobytes(), byteStride=28)
    meshes = []
    for first in (0, len(ours)):
        attributes = {}
        for name, at, kind in (("POSITION", 0, 5126), ("NORMAL", 12, 5126), ("COLOR_0", 24, 5121)):
            entry: Json = {"bufferView": view, "byteOffset": 28 * first + at, "componentType": kind, "count": len(ours)}
            entry |= {"type": "VEC4", "normalized": True} if kind == 5121 else {"type": "VEC3"}
            if name == "POSITION":
                mine = rows[first : first + len(ours), :3]
                entry |= {"min": mine.min(axis=0).tolist(), "max": mine.max(axis=0).tolist()}
            builder.json["accessors"].append(entry)
            attributes[name] = len(builder.json["accessors"]) - 1
        indices = builder.accessor(BALL.faces.ravel(), "<u2")
        meshes.append({"primitives": [{"attributes": attributes, "indices": indices}]})
    return builder.document(meshes=meshes, nodes=[{"mesh": 0}, {"mesh": 1}], scenes=[{"nodes": [0, 1]}])


def sharing() -> Document:
    """Three primitives on the vertices of one, with a morph target and no common triangle."""
    builder = Builder()
    first = builder.primitive(BALL.positions, BALL.faces[0::3])
    first["targets"] = [{"POSITION": builder.accessor(BALL.positions / 10)}]
    rest = [builder.accessor(BALL.faces[start::3].ravel(), "<u2") for start in (1, 2)]
    return builder.document(meshes=[{"primitives": [first, *({**first, "indices": number} for number in rest)]}])


def with_unreferenced() -> Document:
    """It carries a clean copy of itself already, and a mesh that no node draws."""
    builder = Builder()
    builder.primitive(BALL.positions, BALL.faces)
    meshes = [{"primitives": [builder.primitive(BALL.positions, BALL.faces)]} for _ in range(2)]
    document = builder.document(meshes=meshes)
    return Document(document.json, document.binary + b"rest")


def levels() -> Document:
    """A level of detail of the ball, and a second scene that draws the ball itself."""
    builder = Builder()
    coarse = sphere(1.0, 2)
    meshes = [{"primitives": [builder.primitive(part.positions, part.faces)]} for part in (BALL, coarse)]
    nodes = [{"mesh": 0, "extensions": {"MSFT_lod": {"ids": [1]}}}, {"mesh": 1}, {"mesh": 0, "translation": [3, 0, 0]}]
    return builder.document(
        meshes=meshes, nodes=nodes, scenes=[{"nodes": [0]}, {"nodes": [2]}], extensionsUsed=["MSFT_lod"]
    )


def strips() -> Document:
    """A triangle strip without indices, seen from both sides."""
    builder = Builder()
    x = np.repeat(np.linspace(0, 4, 9), 2)
    points = np.column_stack([x, np.tile([0, 2], 9), np.zeros(18)])
    primitive = {**builder.primitive(points, None), "mode": 5, "material": 0}
    return builder.document(meshes=[{"primitives": [primitive]}], materials=[{"doubleSided": True}])


def mirrored_and_sheared() -> Document:
    """A box drawn plain, mirrored, and sheared by a rotation under a stretched and mirrored parent."""
    builder = Builder()
    mesh = {"primitives": [builder.primitive(CUBE, CUBE_FACES)]}
    half = 0.7071068
    nodes = [
        {"mesh": 0},
        {"mesh": 0, "scale": [-1, 1, 1], "translation": [4, 0, 0]},
        {"scale": [3, -0.5, 1], "translation": [0, 6, 0], "children": [3]},
        {"mesh": 0, "rotation": [0, 0, half * 0.5411961, half * 1.3065630]},
    ]
    return builder.document(meshes=[mesh], nodes=nodes, scenes=[{"nodes": [0, 1, 2]}])


def glb(document: Document) -> bytes:
    return document.to_glb()


GLBS: dict[str, Callable[[], Document]] = {
    "plain": partial(simple, CUBE, CUBE_FACES),
    "ball": ball,
    "double-sided": partial(ball, doubleSided=True),
    "inside out": partial(simple, CUBE, INWARDS),
    "rich": rich,
    "draco": lambda: draco(ball()),
    "meshopt": lambda: meshopted(ball()),
    "instanced": partial(instanced, CUBE, CUBE_FACES, TRANSLATION=(OFFSETS, "<f4")),
    "quantised": quantised,
    "interleaved": interleaved,
    "sharing": sharing,
    "carries a copy": with_unreferenced,
    "levels and scenes": levels,
    "strips": strips,
    "mirrored and sheared": mirrored_and_sheared,
    "open sheet": partial(simple, POINTS, FACES),
}
CASES = {name: (build, ASKED) for name, build in GLBS.items()} | {
    "ball, red": (ball, ASKED.model_copy(update={"color": "#d02020"})),
    "rich, red": (rich, ASKED.model_copy(update={"color": "#d02020"})),
    "ball, sunken": (ball, ASKED.model_copy(update={"mode": Mode.DEBOSS})),
}


def judged(data: bytes, original: bytes, asked: Parameters) -> Result:
    """The result, once nothing is found in it."""
    result = watermark(data, asked, preview=False)
    assert residue(result.model, original) == []
    assert gives(result.model, original) == []
    assert telltale_names(result.model, original) == []
    assert undrawn(result.model, result.report["watermarks"], original) == []
    return result


@pytest.mark.parametrize("name", CASES)
def test_a_glb_of_any_kind_keeps_nothing_back_and_shows_every_mark(name: str) -> None:
    build, asked = CASES[name]
    data = build().to_glb()
    judged(data, data, asked)


@pytest.mark.parametrize("name", [name for name in SAMPLES if name != "glb"])
def test_a_file_of_any_format_keeps_nothing_back_and_shows_every_mark(name: str) -> None:
    data = SAMPLES[name]
    judged(data, document_of(admit(data)).to_glb(), ASKED)
