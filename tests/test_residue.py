"""The judge of what is left finds what is planted, and nothing in sound files."""

import base64
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from core.gltf.document import Document
from tests.core.formats.samples import png
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder, grid, simple
from tests.core.gltf.compressed import draco, instanced, meshopted
from tests.core.gltf.rich import rich
from tests.residue import residue

POINTS, FACES = grid(4)
SHEET = simple(POINTS, FACES)
MOVED = simple(POINTS + np.array([0, 0, 0.5]), FACES)  # the same after an edit


def lean(document: Document) -> Document:
    """A compressed document without the plain bytes that it was made of."""
    size, views = len(SHEET.binary), document.json["bufferViews"]
    kept = [number for number, view in enumerate(views) if view["byteOffset"] >= size or "extensions" in view]
    for view in views:
        for place in (view, *view.get("extensions", {}).values()):
            if place["buffer"] == 0:
                place["byteOffset"] -= size
    document.json["bufferViews"] = [views[number] for number in kept]
    for primitive in document.json["meshes"][0]["primitives"]:
        for said in primitive.get("extensions", {}).values():
            said["bufferView"] = kept.index(said["bufferView"])
    document.json["buffers"][0]["byteLength"] -= size
    return Document(document.json, document.binary[size:])


SOUND = {
    "plain": SHEET,
    "rich": rich(),
    "draco": lean(draco(SHEET)),
    "meshopt": lean(meshopted(SHEET)),
    "instanced": instanced(CUBE, CUBE_FACES, TRANSLATION=(np.eye(3) * 4, "<f4")),
}


@pytest.mark.parametrize("name", SOUND)
def test_a_sound_file_holds_nothing_that_it_does_not_draw(name: str) -> None:
    data = SOUND[name].to_glb()
    assert residue(data) == residue(data, data) == []


def _made(**plant: Any) -> Callable[[Builder, dict[str, Any]], None]:
    return lambda builder, _: builder.json.update(plant)


def _stowed(text: str) -> Callable[[Builder, dict[str, Any]], None]:
    def plant(builder: Builder, _: dict[str, Any]) -> None:
        builder.json["extras"] = {"note": text}

    return plant


def _accessor(builder: Builder, _: dict[str, Any]) -> None:
    builder.accessor(POINTS)


def _view(builder: Builder, _: dict[str, Any]) -> None:
    builder.view(POINTS.tobytes())


def _bytes(builder: Builder, _: dict[str, Any]) -> None:
    builder.binary += b"what is this?"


def _row(builder: Builder, primitive: dict[str, Any]) -> None:
    moved = np.vstack([POINTS + np.array([0, 0, 0.5]), [[9, 9, 9]]])
    builder.json["bufferViews"].clear()
    builder.json["accessors"].clear()
    builder.binary = b""
    primitive.update(builder.primitive(moved, FACES))


def _slots(builder: Builder, primitive: dict[str, Any]) -> None:
    """The clean copy between the elements of an interleaved view."""
    moved = (POINTS + np.array([0, 0, 0.5])).astype("<f4")
    view = builder.view(np.hstack([moved, POINTS]).astype("<f4").tobytes(), byteStride=24)
    entry = builder.json["accessors"][primitive["attributes"]["POSITION"]]
    entry["bufferView"] = view


def _mesh(builder: Builder, _: dict[str, Any]) -> None:
    builder.json["more"] = builder.primitive(POINTS, FACES)


def _buffer(_: Builder, __: dict[str, Any]) -> None:
    pass


def planted(plant: Callable[[Builder, dict[str, Any]], None], **objects: Any) -> bytes:
    builder = Builder()
    primitive = builder.primitive(POINTS + np.array([0, 0, 0.5]), FACES)
    plant(builder, primitive)
    meshes = [{"primitives": [primitive]}]
    if more := builder.json.pop("more", None):
        meshes.append({"primitives": [more]})
    document = builder.document(meshes=meshes, **objects)
    if plant is _buffer:
        uri = "data:application/octet-stream;base64," + base64.b64encode(POINTS.tobytes()).decode()
        document.json["buffers"].append({"byteLength": POINTS.nbytes, "uri": uri})
    return document.to_glb()


PLANTS = {
    "accessor": (_accessor, "accessors[2] is not used"),
    "view": (_view, "bufferViews[2] is not used"),
    "bytes": (_bytes, "13 bytes of buffers[0] belong to nothing"),
    "row": (_row, "has 1 rows that no triangle uses"),
    "slots": (_slots, "belong to nothing"),
    "mesh": (_mesh, "meshes[1] is not used"),
    "buffer": (_buffer, "buffers[1] is not used"),
}


@pytest.mark.parametrize("name", PLANTS)
def test_what_is_planted_is_found_in_the_file_alone(name: str) -> None:
    plant, sentence = PLANTS[name]
    assert any(sentence in found for found in residue(planted(plant)))


@pytest.mark.parametrize(
    "plant",
    [_accessor, _view, _slots, _mesh, _buffer, _stowed(base64.b64encode(POINTS.tobytes()).decode())],
    ids=["accessor", "view", "slots", "mesh", "buffer", "base64 in extras"],
)
def test_old_bytes_are_found_wherever_they_stand(plant: Callable[[Builder, dict[str, Any]], None]) -> None:
    found = residue(planted(plant), SHEET.to_glb())
    if plant is _slots:  # not in one piece, but as bytes that belong to nothing
        assert found
    else:
        assert any("the old POSITION (accessors[0]) stands in" in sentence for sentence in found)


@pytest.mark.parametrize("compress", [draco, meshopted])
def test_the_stream_of_a_touched_primitive_is_found(compress: Callable[[Document], Document]) -> None:
    before = compress(SHEET)
    assert any("belong to nothing" in sentence for sentence in residue(before.to_glb())), "the plain bytes beside it"
    builder = Builder()
    builder.view(before.binary)
    after = builder.document(meshes=[{"primitives": [builder.primitive(POINTS + np.array([0, 0, 0.5]), FACES)]}])
    assert any("stream" in sentence for sentence in residue(after.to_glb(), before.to_glb()))


def test_an_image_that_no_texture_shows_is_found() -> None:
    builder = Builder()
    image = builder.view(png(1, 2, 3))
    mesh = {"primitives": [builder.primitive(POINTS, FACES)]}
    document = builder.document(meshes=[mesh], images=[{"bufferView": image, "mimeType": "image/png"}])
    assert residue(document.to_glb()) == ["images[0] is not used"]


def test_bytes_behind_the_glb_are_found() -> None:
    assert residue(SHEET.to_glb() + b"1234") == ["4 bytes lie behind the GLB"]


def test_a_primitive_that_nobody_touched_may_keep_its_unused_rows_and_no_more() -> None:
    some, others = FACES[:8], FACES[8:]
    builder = Builder()
    first = builder.primitive(POINTS, some)
    second = {"attributes": first["attributes"], "indices": builder.accessor(others.ravel(), "<u2")}
    before = builder.document(meshes=[{"primitives": [first, second]}])
    assert residue(before.to_glb(), before.to_glb()) == []
    kept = Document(json.loads(json.dumps(before.json)), before.binary)
    builder = Builder()
    builder.json, builder.binary = kept.json, kept.binary
    new = builder.primitive(POINTS + np.array([0, 0, 0.5]), FACES)
    after = builder.document(meshes=[{"primitives": [first, new]}])
    assert any("rows that no triangle uses" in sentence for sentence in residue(after.to_glb(), before.to_glb()))
