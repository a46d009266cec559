"""Images made smaller, and those that nothing shows left out."""

from io import BytesIO
from typing import Any

import numpy as np
from PIL import Image

from core.gltf.document import Document
from core.gltf.smaller_textures import smaller_textures
from tests.core.gltf.builder import QUAD, QUAD_FACES, Builder
from tests.core.gltf.ktx2_samples import UASTC
from tests.validator import error_counts

COARSE = 16


def encoded(width: int, height: int, kind: str, mode: str = "RGB") -> bytes:
    noise = np.random.default_rng(width).integers(0, 256, (height, width, len(mode)), dtype=np.uint8)
    data = BytesIO()
    Image.fromarray(noise).save(data, kind)
    return data.getvalue()


def textured(images: list[bytes | str], textures: list[dict[str, Any]], **material: Any) -> Document:
    builder = Builder()
    uv = builder.accessor(np.array(QUAD)[:, :2])
    primitive = builder.primitive(QUAD, QUAD_FACES, TEXCOORD_0=uv) | {"material": 0}
    kinds = {b"\x89P": "image/png", b"\xff\xd8": "image/jpeg", b"RI": "image/webp", b"\xabK": "image/ktx2"}
    entries = [
        {"uri": image} if isinstance(image, str) else {"bufferView": builder.view(image), "mimeType": kinds[image[:2]]}
        for image in images
    ]
    return builder.document(
        meshes=[{"primitives": [primitive]}], materials=[material], textures=textures, images=entries
    )


def colored(index: int = 0) -> dict[str, Any]:
    return {"pbrMetallicRoughness": {"baseColorTexture": {"index": index}}}


def picture(document: Document, number: int) -> Image.Image:
    data = document.image(number)
    assert data is not None
    return Image.open(BytesIO(data))


def test_the_longer_side_has_as_many_pixels_as_are_asked_for_and_the_kind_stays() -> None:
    for kind, mode in (("PNG", "RGB"), ("PNG", "RGBA"), ("JPEG", "RGB")):
        document = textured([encoded(100, 50, kind, mode)], [{"source": 0}], **colored())
        small, sizes, lost = smaller_textures(document, COARSE)
        assert (sizes, lost) == ([(16, 8)], [])
        assert (picture(small, 0).size, picture(small, 0).format, picture(small, 0).mode) == ((16, 8), kind, mode)
        assert not error_counts(small.to_glb())


def test_small_images_keep_their_bytes() -> None:
    data = encoded(16, 9, "PNG")
    small, sizes, _ = smaller_textures(textured([data], [{"source": 0}], **colored()), COARSE)
    assert bytes(small.image(0) or b"") == data
    assert sizes == [(16, 9)]


def test_other_formats_become_those_that_every_viewer_reads() -> None:
    webp = {"extensions": {"EXT_texture_webp": {"source": 0}}}
    basisu = {"source": 1, "extensions": {"KHR_texture_basisu": {"source": 0}}}
    for image, texture in ((encoded(40, 40, "WEBP"), webp), (UASTC, basisu)):
        document = textured([image, encoded(64, 64, "PNG")], [texture], **colored())
        document.json |= {"extensionsUsed": ["EXT_texture_webp", "KHR_texture_basisu"]}
        document.json |= {"extensionsRequired": ["EXT_texture_webp"]}
        small, sizes, lost = smaller_textures(document, COARSE)
        assert lost == []
        assert max(sizes[0]) <= COARSE
        assert "extensions" not in small.json["textures"][0]
        assert "extensionsUsed" not in small.json
        assert "extensionsRequired" not in small.json
        assert picture(small, small.json["textures"][0]["source"]).format in ("PNG", "JPEG")
        assert not error_counts(small.to_glb())


def test_images_that_nothing_shows_are_gone_and_those_that_cannot_be_made_smaller_are_taken_off() -> None:
    shown = encoded(30, 30, "PNG")
    document = textured(
        [encoded(60, 60, "PNG"), shown, "beside.png", encoded(50, 50, "PNG")],
        [{"source": 1}, {"source": 2}, {"source": 3}],
        **colored(),
        emissiveTexture={"index": 1},
        emissiveFactor=[1.0, 1.0, 1.0],
    )
    small, sizes, lost = smaller_textures(document, COARSE)
    assert (sizes, lost) == ([(16, 16)], [1])
    assert len(small.json["images"]) == 2
    assert picture(small, 0).size == (1, 1)
    assert small.json["textures"] == [{"source": 1}, {}, {}]
    assert "emissiveTexture" not in small.json["materials"][0]
    assert small.json["materials"][0]["emissiveFactor"] == [0, 0, 0], "without its texture all of it would glow"
    assert len(small.to_glb()) < len(document.to_glb()) / 4


def test_textures_of_extensions_count_and_a_document_without_any_stays() -> None:
    coat = {"KHR_materials_clearcoat": {"clearcoatFactor": 1.0, "clearcoatTexture": {"index": 0}}}
    _, sizes, lost = smaller_textures(textured([encoded(40, 20, "PNG")], [{"source": 0}], extensions=coat), COARSE)
    assert (sizes, lost) == ([(16, 8)], [])
    plain = Builder()
    document = plain.document(meshes=[{"primitives": [plain.primitive(QUAD, QUAD_FACES)]}])
    assert smaller_textures(document, COARSE) == (document, [], [])
