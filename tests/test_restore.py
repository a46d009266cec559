"""The restore attack gets the clean asset back from a file that was edited carelessly, and not from a careful one."""

from typing import Any

import numpy as np
import pytest

from tests.core.gltf.builder import Builder, grid
from tests.restore import gives, guesses, recovered, telltale_names

POINTS, FACES = grid(8)
GONE = np.array([20, 44, 70, 88, 100])  # apart from each other
KEPT = np.delete(FACES, GONE, axis=0)
# In place of each face that goes, a low pyramid over it.
TOPS = POINTS[FACES[GONE]].mean(axis=1) + np.array([0, 0, 0.2])
NEW = np.concatenate(
    [[[a, b, 81 + n], [b, c, 81 + n], [c, a, 81 + n]] for n, (a, b, c) in enumerate(FACES[GONE].tolist())]
)
ALL = np.concatenate([POINTS, TOPS])
RNG = np.random.default_rng(5)


def original() -> bytes:
    builder = Builder()
    return builder.document(meshes=[{"primitives": [builder.primitive(POINTS, FACES)]}]).to_glb()


def edited(points: Any, faces: Any, *, carry: str = "", own: bool = False) -> bytes:
    builder = Builder()
    if carry == "bytes":
        builder.view(POINTS.tobytes())
        builder.view(FACES.astype("<u2").tobytes())
        builder.json["bufferViews"].clear()
    elif carry == "accessors":
        builder.primitive(POINTS, FACES)
    if not own:
        return builder.document(meshes=[{"primitives": [builder.primitive(points, faces)]}]).to_glb()
    kept = builder.primitive(POINTS, KEPT)
    letters = {**builder.primitive(ALL[NEW.ravel()], np.arange(NEW.size)), "material": 1}
    materials: list[dict[str, Any]] = [{}, {"name": "meshmark"}]
    return builder.document(meshes=[{"primitives": [{**kept, "material": 0}, letters]}], materials=materials).to_glb()


def shuffled() -> bytes:
    faces = np.concatenate([KEPT, NEW])
    order = RNG.permutation(len(ALL))
    place = np.argsort(order)
    return edited(ALL[order], place[faces][RNG.permutation(len(faces))])


@pytest.mark.parametrize(
    ("name", "careless"),
    [
        ("accessors[0] by 1", edited(ALL, np.concatenate([KEPT, NEW]), carry="accessors")),
        ("bytes 0", edited(ALL, np.concatenate([KEPT, NEW]), carry="bytes")),
        ("the first", edited(ALL, np.concatenate([KEPT, NEW]))),
        ("by their names", edited(ALL, FACES, own=True)),
    ],
    ids=["old accessors", "old bytes", "old rows first", "names"],
)
def test_what_a_careless_edit_leaves_is_read(name: str, careless: bytes) -> None:
    assert any(name in how for how in gives(careless, original()))


def test_a_careful_edit_gives_nothing() -> None:
    assert gives(shuffled(), original()) == []
    assert telltale_names(shuffled(), original()) == []
    assert telltale_names(edited(ALL, FACES, own=True), original()) == ["meshmark"]


def test_the_whole_asset_is_recovered_where_it_was_carried_along() -> None:
    marked = edited(ALL, np.concatenate([KEPT, NEW]), carry="accessors")
    assert max(recovered(soup, original(), marked) for _, soup in guesses(marked)) == 1
