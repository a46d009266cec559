"""Assets as plain GLBs, as viewers that decode nothing show them."""

import copy
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.conversion import decoded, plain_glb
from core.errors import MeshmarkError
from core.gltf.accessors import read_accessor
from core.gltf.document import Document
from core.gltf.scene import scene_of
from core.gltf.textures import BASISU
from tests.core.formats.samples import SAMPLES
from tests.core.gltf.compressed import draco, meshopted
from tests.core.gltf.ktx2_samples import ETC1S, UASTC
from tests.validator import error_counts

SPOT = Document.from_glb((Path(__file__).parents[1] / "data" / "spot.glb").read_bytes())


def with_image(content: bytes, mime_type: str) -> Document:
    """Spot with another image as its texture."""
    json = copy.deepcopy(SPOT.json)
    json["bufferViews"].append({"buffer": 0, "byteOffset": len(SPOT.binary), "byteLength": len(content)})
    json["buffers"][0]["byteLength"] = len(SPOT.binary) + len(content)
    json["images"] = [{"bufferView": len(json["bufferViews"]) - 1, "mimeType": mime_type}]
    json["textures"] = [{"extensions": {BASISU: {"source": 0}}} if mime_type == "image/ktx2" else {"source": 0}]
    if mime_type == "image/ktx2":
        json["extensionsUsed"] = json["extensionsRequired"] = [BASISU]
    return replace(SPOT, json=json, binary=SPOT.binary + content)


def picture_of(document: Document) -> Image.Image:
    content = document.image(document.entry("textures", 0)["source"])
    assert content is not None
    return Image.open(io.BytesIO(content))


@pytest.mark.parametrize("compress", [draco, meshopted])
def test_compressed_geometry_is_plain_and_the_same(compress: Callable[[Document], Document]) -> None:
    compressed = compress(SPOT)
    plain = plain_glb(compressed.to_glb())
    document = Document.from_glb(plain)
    assert not {"extensionsUsed", "extensionsRequired"} & document.json.keys()
    assert not error_counts(plain) - error_counts(SPOT.to_glb())
    [before], [after] = ([m["primitives"][0] for m in each.json["meshes"]] for each in (compressed, document))
    pairs = [(before["indices"], after["indices"])]
    pairs += [(number, after["attributes"][name]) for name, number in before["attributes"].items()]
    for was, now in pairs:
        np.testing.assert_array_equal(read_accessor(compressed, was), read_accessor(document, now))
    assert len(document.json["buffers"]) == 1
    assert document.json["images"] == SPOT.json["images"]


@pytest.mark.parametrize("content", [ETC1S, UASTC])
def test_a_ktx2_texture_becomes_a_png_of_the_same_colours(content: bytes) -> None:
    document = decoded(with_image(content, "image/ktx2"))
    assert not {"extensionsUsed", "extensionsRequired"} & document.json.keys()
    picture = picture_of(document)
    assert (picture.format, picture.size) == ("PNG", (16, 16))
    red, green, blue, _ = picture.convert("RGBA").getpixel((2, 2))  # type: ignore[misc]
    assert red > 200 > 60 > max(green, blue)


def test_a_texture_that_is_not_there_leaves_the_plain_colour() -> None:
    elsewhere, damaged = copy.deepcopy(SPOT.json), with_image(ETC1S[:100], "image/ktx2")
    elsewhere["images"] = [{"uri": "skin.png"}]
    for document in (replace(SPOT, json=elsewhere), damaged):
        picture = picture_of(decoded(document))
        assert (picture.size, picture.getpixel((0, 0))) == ((1, 1), (255, 255, 255, 255))


@pytest.mark.parametrize("name", SAMPLES)
def test_every_format_becomes_a_glb_that_is_complete_in_itself(name: str) -> None:
    document = Document.from_glb(plain_glb(SAMPLES[name]))
    assert not [part for kind in ("buffers", "images") for part in document.json.get(kind, []) if "uri" in part]
    assert len(scene_of(document.to_glb()).surface.faces)


def test_what_is_damaged_is_refused_as_when_it_is_to_be_marked() -> None:
    with pytest.raises(MeshmarkError, match="truncated_file"):
        plain_glb(SPOT.to_glb()[:-1000])
