"""What goes in comes out: input and output compared at glTF level, property by property."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from core.choices import Evaluate
from core.gltf.accessors import dequantize, read_accessor
from core.gltf.document import Document
from core.parameters import Parameters
from core.pipeline import watermark
from tests.core.gltf.builder import CUBE, CUBE_FACES, simple
from tests.core.gltf.compressed import draco, instanced, meshopted
from tests.core.gltf.rich import rich

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


@pytest.mark.parametrize("color", ["none", "#d02020"], ids=["same material", "coloured"])
@pytest.mark.parametrize("name", GLBS)
def test_everything_but_the_touched_triangles_comes_back_as_it_was(name: str, color: str) -> None:
    source = GLBS[name]
    data = source.to_glb() if isinstance(source, Document) else source.read_bytes()
    asked = Parameters(text="watermark", count=4, size=3.0, color=color, evaluate=Evaluate.NONE)
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
            touched += not _compare_primitive(before, after, old_primitive, new_primitive)
    return touched + _added_draws(before, after)


def _added_draws(before: Document, after: Document) -> int:
    """Instances that became nodes of their own because they carry a mark."""
    return sum("mesh" in node for node in after.json.get("nodes", [])[len(before.json.get("nodes", [])) :])


def _compare_primitive(before: Document, after: Document, old: Json, new: Json) -> bool:
    """Material, extras and kinds of attributes stay; the triangles that are left are old ones, to the last bit of
    every attribute and target. Returns whether all are left, in their old order.

    Where letters have a colour, vertex colours may be new: white on the ground, or the factor of its material, if that
    is a copy without it."""
    factor = _factor_taken(before, after, old, new)
    assert old.get("extras") == new.get("extras")
    assert [name for name in new["attributes"] if name not in old["attributes"]] in ([], ["COLOR_0"])
    assert list(old["attributes"]) == [name for name in new["attributes"] if name in old["attributes"]]
    assert [list(target) for target in old.get("targets", [])] == [list(target) for target in new.get("targets", [])]
    was, now = _corners(before, old, old, factor), _corners(after, new, old)
    if np.array_equal(was, now):
        return True
    if old.get("mode", 4) == 4:
        known, left = set(_triangles(was)), _triangles(now)
        kept = [triangle for triangle in left if triangle in known]
        assert len(set(kept)) >= 0.25 * len(known)
    if "COLOR_0" not in old["attributes"] and "COLOR_0" in new["attributes"]:
        colors = _values(after, new["attributes"]["COLOR_0"])[:, :3]
        assert (np.abs(colors - factor) < 1e-4).all(axis=1).mean() > 0.25, "the ground"
    return False


def _factor_taken(before: Document, after: Document, old: Json, new: Json) -> NDArray[np.float64]:
    """The factor (3,) that went from a material into vertex colours; 1 where the material is the same."""
    if old.get("material") == new.get("material"):
        return np.ones(3)
    source, copy = (json["materials"][part["material"]] for json, part in ((before.json, old), (after.json, new)))
    factor = source["pbrMetallicRoughness"]["baseColorFactor"]
    plain = {"baseColorFactor": [1.0, 1.0, 1.0, factor[3]]}
    assert copy == source | {"pbrMetallicRoughness": source["pbrMetallicRoughness"] | plain}
    return np.array(factor[:3])


def _corners(document: Document, primitive: Json, like: Json, factor: Any = 1.0) -> NDArray[np.float32]:
    """(C, n) all attributes that a primitive ``like`` it has, and all targets, of its corners in the order it draws
    them; vertex colours times ``factor``."""
    columns = []
    for attributes in (primitive["attributes"], *primitive.get("targets", [])):
        for name, number in attributes.items():
            if attributes is primitive["attributes"] and name not in like["attributes"]:
                continue
            column = _values(document, number)
            if name == "COLOR_0":
                column[:, :3] = np.round(column[:, :3] * factor, 4)
            columns.append(column.reshape(len(column), -1))
    rows = np.hstack(columns).astype(np.float32) + 0.0
    return rows[read_accessor(document, primitive["indices"])] if "indices" in primitive else rows


def _triangles(corners: NDArray[np.float32]) -> list[tuple[bytes, ...]]:
    """The corners of each triangle in their order, from the lowest on."""
    found: list[tuple[bytes, ...]] = []
    for triangle in corners[: len(corners) // 3 * 3].reshape(-1, 3, corners.shape[1]):
        a, b, c = (corner.tobytes() for corner in triangle)
        found.append(min((a, b, c), (b, c, a), (c, a, b)))
    return found


def _values(document: Document, number: int) -> NDArray[np.float64]:
    return dequantize(read_accessor(document, number), document.json["accessors"][number])
