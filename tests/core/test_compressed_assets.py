"""Compressed and instanced assets through the whole engine."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from core.choices import Evaluate
from core.gltf.compression import DRACO
from core.gltf.document import Document
from core.gltf.prune import unreferenced_bytes
from core.parameters import Parameters
from core.pipeline import Result, watermark
from tests.core.formats.meshes import MESHES
from tests.core.gltf.compressed import MESHOPT, draco, meshopted
from tests.validator import error_counts

SPOT = Path(__file__).parents[1] / "data" / "spot.glb"
INSTANCING = "EXT_mesh_gpu_instancing"
TWO = Parameters(text="watermark", count=2, size=3.0, color="none", evaluate=Evaluate.GEOMETRY)


def _marked(data: bytes) -> Result:
    """The marked asset, which is as valid as it was and whose topology is as it was."""
    result = watermark(data, TWO, preview=False)
    assert not error_counts(result.model) - error_counts(data)
    asset, model = result.report["asset"], result.report["model"]
    for fact in ("watertight", "components", "boundary_edges", "nonmanifold_edges"):
        assert model[fact] == asset[fact]
    assert result.report["metrics"]["asset_utility"]["ipe"] == 0
    assert result.report["watermarks"]
    return result


@pytest.mark.parametrize("compress", [draco, meshopted])
def test_a_compressed_asset_is_marked_and_comes_back_plain(compress: Callable[[Document], Document]) -> None:
    spot = Document.from_glb(SPOT.read_bytes())
    compressed = compress(spot)
    result = Document.from_glb(_marked(compressed.to_glb()).model)
    assert not {"extensionsUsed", "extensionsRequired"} & result.json.keys()
    assert result.json["materials"] == spot.json["materials"]
    assert result.json["images"] == spot.json["images"]


def test_of_many_instances_only_the_marked_ones_become_meshes_of_their_own() -> None:
    document = Document.from_glb(SPOT.read_bytes())
    places = np.array([[2.0 * column, 0, 3.0 * row] for column in range(3) for row in range(2)], "<f4")
    node = next(node for node in document.json["nodes"] if "mesh" in node)
    node["extensions"] = {INSTANCING: {"attributes": {"TRANSLATION": len(document.json["accessors"])}}}
    document.json["extensionsUsed"] = document.json["extensionsRequired"] = [INSTANCING]
    view = {"buffer": 0, "byteOffset": len(document.binary), "byteLength": places.nbytes}
    document.json["accessors"].append(
        {"bufferView": len(document.json["bufferViews"]), "componentType": 5126, "count": len(places), "type": "VEC3"}
    )
    document.json["bufferViews"].append(view)
    document.binary += places.tobytes()
    document.json["buffers"][0]["byteLength"] = len(document.binary)
    result = _marked(document.to_glb())
    after = Document.from_glb(result.model).json
    ours = next(node for node in after["nodes"] if INSTANCING in node.get("extensions", {}))
    (left,) = (after["accessors"][number]["count"] for number in ours["extensions"][INSTANCING]["attributes"].values())
    assert len(ours["children"]) in (1, 2)
    assert left == len(places) - len(ours["children"])
    assert len(after["meshes"]) == 1 + len(ours["children"])
    assert after["meshes"][0] == document.json["meshes"][0]


_REAL = {
    "chess-board": [DRACO],
    "box-textured-meshopt": [],
    "lamborghini": [MESHOPT],
    "nasa-ingenuity": [MESHOPT],
}


@pytest.mark.parametrize("name", [name for name in _REAL if (MESHES / f"{name}.glb").exists()])
def test_a_real_compressed_asset_is_marked_and_says_what_is_still_compressed(name: str) -> None:
    data = (MESHES / f"{name}.glb").read_bytes()
    after, before = Document.from_glb(_marked(data).model), Document.from_glb(data)
    for key in ("extensionsUsed", "extensionsRequired"):
        others = [extension for extension in before.json[key] if extension not in (DRACO, MESHOPT)]
        assert sorted(after.json.get(key, [])) == sorted(others + _REAL[name])
    assert unreferenced_bytes(after) == 0
