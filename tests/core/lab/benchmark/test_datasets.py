"""The paper's datasets as they lie on disk, and the stratified draw."""

import gzip
import json
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.datasets import LAYOUTS, Asset, load, stratified


def tree(root: Path, *names: str) -> Path:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(b"x")
    return root


def found(root: Path, layout: str, split: str = "train") -> dict[str, str]:
    return {asset.name: asset.kind for asset in load(root, layout, split).assets}


def test_a_plain_folder_gives_every_accepted_file_and_names_the_others(tmp_path: Path) -> None:
    tree(tmp_path, "a.glb", "B.STL", "animals/cat.obj", "MANIFEST.csv", "LICENSES.md", ".hidden.glb", "__MACOSX/a.glb")
    dataset = load(tmp_path, "folder", "train")
    assert [(asset.name, asset.kind) for asset in dataset.assets] == [
        ("B.STL", ""),
        ("a.glb", ""),
        ("animals/cat.obj", "animals"),
    ]
    assert dataset.notes == ["2 files ignored, not of a format Meshmark reads: LICENSES.md, MANIFEST.csv."]


@pytest.mark.parametrize("inner", ["", "Manifold40/"])
def test_manifold40_is_read_by_class_and_split_from_its_folder_or_the_one_above(tmp_path: Path, inner: str) -> None:
    names = ("airplane/train/airplane_0001.obj", "airplane/test/airplane_0627.obj", "night_stand/train/n_1.obj")
    tree(tmp_path, *(inner + name for name in names))
    assert found(tmp_path, "manifold40") == {names[0]: "airplane", names[2]: "night_stand"}
    assert found(tmp_path, "manifold40", "test") == {names[1]: "airplane"}


def test_modelnet40_is_read_as_off_files(tmp_path: Path) -> None:
    tree(tmp_path, "ModelNet40/chair/train/chair_0001.off", "ModelNet40/chair/train/.DS_Store", "ModelNet40/README.txt")
    assert found(tmp_path, "modelnet40") == {"chair/train/chair_0001.off": "chair"}


@pytest.mark.parametrize("packed", [True, False])
def test_objaverse_takes_its_classes_from_the_lvis_annotations(tmp_path: Path, packed: bool) -> None:
    root = tree(tmp_path / "hf-objaverse-v1", "glbs/000-000/u1.glb", "glbs/000-159/u2.glb", "glbs/000-159/u3.glb")
    annotations = json.dumps({"mug": ["u1", "elsewhere"], "apple": ["u2", "u1"]}).encode()
    if packed:
        (root / "lvis-annotations.json.gz").write_bytes(gzip.compress(annotations))
    else:
        (root / "lvis-annotations.json").write_bytes(annotations)
    assert found(tmp_path, "objaverse") == {"glbs/000-000/u1.glb": "apple", "glbs/000-159/u2.glb": "apple"}
    assert load(tmp_path, "objaverse", "train").notes == ["1 objects without an LVIS class left out."]


def test_objaverse_without_annotations_is_one_class(tmp_path: Path) -> None:
    tree(tmp_path, "glbs/000-000/u1.glb", "object-paths.json.gz")
    assert found(tmp_path, "objaverse") == {"glbs/000-000/u1.glb": ""}


def test_damaged_annotations_are_named(tmp_path: Path) -> None:
    tree(tmp_path, "glbs/000-000/u1.glb", "lvis-annotations.json.gz")
    with pytest.raises(MeshmarkError) as caught:
        load(tmp_path, "objaverse", "train")
    assert caught.value.code is ErrorCode.MALFORMED_FILE


def test_meshy_counts_one_file_for_each_asset_a_glb_first(tmp_path: Path) -> None:
    tree(tmp_path, "dragon.glb", "dragon.obj", "cup.zip", "lamp/model.obj", "lamp/model.glb", "lamp/texture_0.png")
    tree(tmp_path, "cat/model.obj", "cat/model.mtl", "cat/model.fbx")
    assert list(found(tmp_path, "meshy")) == ["cat/model.obj", "cup.zip", "dragon.glb", "lamp/model.glb"]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_folder_without_such_assets_is_refused_by_name(tmp_path: Path, layout: str) -> None:
    for folder in (tmp_path, tmp_path / "missing"):
        with pytest.raises(MeshmarkError) as caught:
            load(folder, layout, "train")
        assert caught.value.code is ErrorCode.MISSING_FILE
        assert str(folder) in caught.value.message


def assets(sizes: list[int]) -> list[Asset]:
    return [Asset(Path("x"), f"{kind}/{row}", str(kind)) for kind, size in enumerate(sizes) for row in range(size)]


@given(st.lists(st.integers(1, 12), min_size=1, max_size=8), st.integers(1, 60), st.integers(0, 9))
def test_a_sample_is_as_even_over_the_classes_as_their_sizes_allow(sizes: list[int], count: int, seed: int) -> None:
    drawn = stratified(assets(sizes), count, seed)
    assert len({asset.name for asset in drawn}) == len(drawn) == min(count, sum(sizes))
    taken = Counter(asset.kind for asset in drawn)
    most = max(taken.values())
    for kind, size in enumerate(sizes):
        assert taken[str(kind)] >= min(size, most - 1)


def test_a_sample_depends_on_the_seed_and_not_on_the_order_of_the_files() -> None:
    everything = assets([30, 30])
    first = stratified(everything, 10, seed=1)
    assert first == stratified(everything[::-1], 10, seed=1)
    assert first != stratified(everything, 10, seed=2)
