"""What goes in comes out: input and output compared at glTF level, property by property."""

import os
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from core.asset.gltf import Document, dequantize, read_accessor
from core.parameters import Evaluate, Parameters
from core.pipeline import watermark
from tests.core.asset.builder import CUBE, CUBE_FACES, simple
from tests.core.asset.compressed import draco, instanced, meshopted
from tests.core.asset.rich import rich

Json = dict[str, Any]

OFFSETS = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0]])
MADE = {
    "rich": rich(),
    "draco": draco(simple(CUBE, CUBE_FACES)),
    "meshopt": meshopted(simple(CUBE, CUBE_FACES)),
    "instanced": instanced(CUBE, CUBE_FACES, TRANSLATION=(OFFSETS, "<f4")),
}
MESHES = Path(os.environ.get("MESHMARK_TEST_MESHES", "../shared/meshes"))
DATA = (Path(__file__).parents[1] / "data").glob("*.glb")
GLBS = MADE | {path.stem: path for path in (*sorted(DATA), *sorted(MESHES.glob("*.glb")))}

INSTANCING = "EXT_mesh_gpu_instancing"

# What an edit of the surface may change; everything else, known or unknown, has to be equal.
EDITED = {"accessors", "bufferViews", "buffers", "meshes", "materials", "nodes", "extensionsUsed", "extensionsRequired"}


@pytest.mark.parametrize("color", [None, "#d02020"], ids=["same material", "coloured"])
@pytest.mark.parametrize("name", GLBS)
def test_everything_but_the_touched_triangles_comes_back_as_it_was(name: str, color: str | None) -> None:
    source = GLBS[name]
    data = source.to_glb() if isinstance(source, Document) else source.read_bytes()
    asked = Parameters(text="watermark", count=4, color=color, evaluate=Evaluate.NONE)
    model = watermark(data, asked, preview=False).model
    before, after = Document.from_glb(data), Document.from_glb(model)
    assert {k: v for k, v in before.json.items() if k not in EDITED} == {
        k: v for k, v in after.json.items() if k not in EDITED
    }
    _compare_extensions(before, after)
    assert after.json.get("materials", [])[: len(before.json.get("materials", []))] == before.json.get("materials", [])
    _compare_nodes(before, after)
    _compare_images(before, after)
    _compare_referenced_accessors(before, after)
    touched = _compare_meshes(before, after)
    assert touched > 0


def _compare_extensions(before: Document, after: Document) -> None:
    """Nothing new is used or required; what is gone is really gone."""
    for key in ("extensionsUsed", "extensionsRequired"):
        old, new = before.json.get(key, []), after.json.get(key, [])
        assert set(new) <= set(old)
        text = str({k: v for k, v in after.json.items() if not k.startswith("extensions")})
        for name in set(old) - set(new):
            assert f"'{name}'" not in text


def _compare_nodes(before: Document, after: Document) -> None:
    """Names, hierarchy, transforms, skins, cameras, extras: only the mesh of a node may be another, equal but for
    the marks; nodes may be added behind."""
    for old, new in zip(before.json.get("nodes", []), after.json.get("nodes", []), strict=False):
        ignored = {"mesh", "children", "extensions"}
        assert {k: v for k, v in old.items() if k not in ignored} == {k: v for k, v in new.items() if k not in ignored}
        # A node all of whose instances carry marks is left with one child for each of them.
        assert ("mesh" in old) == ("mesh" in new) or INSTANCING in old["extensions"]
        children = new.get("children", [])
        assert children[: len(old.get("children", []))] == old.get("children", [])
        assert all(child >= len(before.json["nodes"]) for child in children[len(old.get("children", [])) :])
        for name, value in old.get("extensions", {}).items():
            assert name == INSTANCING or new["extensions"][name] == value


def _compare_images(before: Document, after: Document) -> None:
    for old, new in zip(before.json.get("images", []), after.json.get("images", []), strict=True):
        if "bufferView" in old:
            assert _view_bytes(before, old["bufferView"]) == _view_bytes(after, new["bufferView"])


def _view_bytes(document: Document, number: int) -> bytes:
    view = document.json["bufferViews"][number]
    start = view.get("byteOffset", 0)
    return bytes(document.buffer(view["buffer"])[start : start + view["byteLength"]])


def _compare_referenced_accessors(before: Document, after: Document) -> None:
    """Animations and skins: the same accessors with the same values."""
    numbers = [
        accessor
        for animation in before.json.get("animations", [])
        for sampler in animation["samplers"]
        for accessor in (sampler["input"], sampler["output"])
    ]
    numbers += [skin["inverseBindMatrices"] for skin in before.json.get("skins", []) if "inverseBindMatrices" in skin]
    for number in set(numbers):
        assert np.array_equal(read_accessor(before, number), read_accessor(after, number))


def _compare_meshes(before: Document, after: Document) -> int:
    """Every mesh a node draws: equal, or with touched primitives; returns how many primitives were touched."""
    touched = 0
    for old_node, new_node in zip(before.json.get("nodes", []), after.json.get("nodes", []), strict=False):
        if "mesh" not in old_node or "mesh" not in new_node:
            continue
        old, new = before.json["meshes"][old_node["mesh"]], after.json["meshes"][new_node["mesh"]]
        assert {k: v for k, v in old.items() if k != "primitives"} == {
            k: v for k, v in new.items() if k != "primitives"
        }
        # A primitive that became letters from end to end is gone; coloured letters are added behind.
        assert len(new["primitives"]) >= len(old["primitives"])
        for old_primitive, new_primitive in zip(old["primitives"], new["primitives"], strict=False):
            if old_primitive == new_primitive:
                _compare_untouched(before, after, old_primitive)
            else:
                touched += 1
                _compare_touched(before, after, old_primitive, new_primitive)
    return touched + _added_draws(before, after)


def _added_draws(before: Document, after: Document) -> int:
    """Instances that became nodes of their own because they carry a mark."""
    return sum("mesh" in node for node in after.json.get("nodes", [])[len(before.json.get("nodes", [])) :])


def _compare_untouched(before: Document, after: Document, primitive: Json) -> None:
    numbers = [*primitive["attributes"].values(), *([primitive["indices"]] if "indices" in primitive else [])]
    numbers += [number for target in primitive.get("targets", []) for number in target.values()]
    for number in numbers:
        assert before.json["accessors"][number] == after.json["accessors"][number]
        assert read_accessor(before, number).tobytes() == read_accessor(after, number).tobytes()


def _compare_touched(before: Document, after: Document, old: Json, new: Json) -> None:
    """Attributes, targets and material stay; the old rows come first, exactly; the triangles that are left are old
    ones in their old order."""
    assert old.get("material") == new.get("material")
    assert old.get("extras") == new.get("extras")
    assert list(old["attributes"]) == list(new["attributes"])
    maps = [(old["attributes"], new["attributes"]), *zip(old.get("targets", []), new.get("targets", []), strict=True)]
    for old_map, new_map in maps:
        for name, number in old_map.items():
            rows, grown = _values(before, number), _values(after, new_map[name])
            assert np.array_equal(grown[: len(rows)], rows), name
    if old.get("mode", 4) == 4:
        count = len(_values(before, old["attributes"]["POSITION"]))
        triangles = _triangles(before, old, count)
        left = _triangles(after, new, count)
        left = left[(left < count).all(axis=1)]
        place = {row: number for number, row in reversed(list(enumerate(map(tuple, triangles.tolist()))))}
        kept = [place.get(row, -1) for row in map(tuple, left.tolist())]
        # The triangles that stay come first, in their old order; re-cut ones that have only old corners come behind.
        ordered = next((k for k, (a, b) in enumerate(pairwise(kept), 1) if b <= a), len(kept))
        assert -1 not in kept[:ordered]
        assert ordered >= 0.5 * len(kept)


def _values(document: Document, number: int) -> NDArray[np.float64]:
    return dequantize(read_accessor(document, number), document.json["accessors"][number])


def _triangles(document: Document, primitive: Json, count: int) -> NDArray[np.int64]:
    indices = read_accessor(document, primitive["indices"]) if "indices" in primitive else np.arange(count)
    return np.asarray(indices, dtype=np.int64).reshape(-1, 3)
