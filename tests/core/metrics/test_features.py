import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper

from core import models
from core.errors import ErrorCode, MeshmarkError
from core.gltf.scene import scene_of
from core.metrics.features import LayoutDescriptor, ResNet50, extractor
from core.metrics.ss import ss
from core.models import MODELS, Model
from core.rendering.pictures import pictures
from core.rendering.renderer import BACKGROUND, Renderer

Pictures = NDArray[np.uint8]

MESHES = Path(os.environ.get("MESHMARK_TEST_MESHES", Path(__file__).parents[4] / "shared" / "meshes"))
ASSETS = [path for name in ("fox", "cesium-man", "truck-yellow-kenney") if (path := MESHES / f"{name}.glb").exists()]

STEP = 0.02


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network with the inputs, outputs and quantised pooling of the zoo's ResNet50, and nothing in between."""
    nodes = [
        helper.make_node("QuantizeLinear", ["data", "step", "zero"], ["data_quantized"]),
        helper.make_node(
            "QLinearGlobalAveragePool",
            ["data_quantized", "step", "zero", "step", "zero"],
            ["resnetv17_pool1_fwd_quantized"],
            domain="com.microsoft",
        ),
        helper.make_node("DequantizeLinear", ["resnetv17_pool1_fwd_quantized", "step", "zero"], ["pooled"]),
        helper.make_node("Flatten", ["pooled"], ["resnetv17_dense0_fwd"]),
    ]
    graph = helper.make_graph(
        nodes,
        "resnet",
        [helper.make_tensor_value_info("data", TensorProto.FLOAT, ["N", 3, 224, 224])],
        [helper.make_tensor_value_info("resnetv17_dense0_fwd", TensorProto.FLOAT, ["N", 3])],
        [
            helper.make_tensor("step", TensorProto.FLOAT, [], [STEP]),
            helper.make_tensor("zero", TensorProto.UINT8, [], [0]),
        ],
    )
    opsets = [helper.make_opsetid("", 12), helper.make_opsetid("com.microsoft", 1)]
    path = tmp_path_factory.mktemp("models") / models.RESNET50.file
    onnx.save(helper.make_model(graph, opset_imports=opsets, ir_version=4), path)
    return path


@pytest.fixture
def installed(network: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which the network stands as the pinned ResNet50."""
    content = network.read_bytes()
    pinned = {"sha256": hashlib.sha256(content).hexdigest(), "size": len(content)}
    monkeypatch.setitem(MODELS, models.RESNET50.name, Model(**{**vars(models.RESNET50), **pinned}))
    return network.parent


def plain(*colors: tuple[int, int, int], size: int = 300) -> Pictures:
    return np.stack([np.full((size, size, 3), color, np.uint8) for color in colors])


def test_without_weights_the_descriptor_serves_and_says_so(tmp_path: Path) -> None:
    assert extractor(tmp_path).name == "hog-color-layout"


def test_with_weights_the_network_serves_and_says_so(installed: Path) -> None:
    assert extractor(installed).name == "resnet50-v1-12-int8"


def test_damaged_weights_are_an_error_and_not_the_descriptor(tmp_path: Path) -> None:
    (tmp_path / models.RESNET50.file).write_bytes(b"not a network")
    with pytest.raises(MeshmarkError) as caught:
        extractor(tmp_path)
    assert caught.value.code is ErrorCode.MODEL_UNAVAILABLE
    assert "meshmark models fetch" in caught.value.remedy


def test_the_network_gets_imagenet_colours_and_gives_the_pooled_activations(installed: Path) -> None:
    colors = [(255, 255, 255), (200, 180, 150), (124, 117, 104)]
    features = extractor(installed)(plain(*colors))
    normal = (np.array(colors) / 255 - [0.485, 0.456, 0.406]) / [0.229, 0.224, 0.225]
    assert features.dtype == np.float32
    np.testing.assert_array_equal(features, np.round(normal / STEP))


def test_the_network_sees_the_whole_picture_with_rows_and_channels_in_place(network: Path) -> None:
    # The mean over the picture of a frame of white one pixel wide in 224: nothing is cropped.
    picture = np.full((224, 224, 3), (124, 117, 104), np.uint8)
    framed = picture.copy()
    framed[[0, -1]] = framed[:, [0, -1]] = 255
    before, after = ResNet50(network)(np.stack([picture, framed]))
    share = 1 - (222 / 224) ** 2
    np.testing.assert_allclose(after - before, share * np.array([112.4, 121.4, 132.0]), atol=1)


def test_batches_do_not_change_the_features(network: Path) -> None:
    resnet = ResNet50(network, threads=1)
    views = np.random.default_rng(0).integers(150, 256, (2 * ResNet50.BATCH + 3, 64, 64, 3)).astype(np.uint8)
    np.testing.assert_array_equal(resnet(views), np.concatenate([resnet(view[None]) for view in views]))


def background(count: int, size: int = 256) -> Pictures:
    return np.full((count, size, size, 3), round(255 * BACKGROUND), np.uint8)


def test_the_descriptor_has_unit_length_and_its_documented_width() -> None:
    views = np.random.default_rng(0).integers(0, 256, (3, 200, 200, 3)).astype(np.uint8)
    features = LayoutDescriptor()(views)
    assert features.shape == (3, 32 * 32 * 9 + 16 * 16 * 9 + 8 * 8 * 3)
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1, rtol=1e-5)


def test_a_vertical_edge_votes_for_one_orientation_in_the_cells_along_it() -> None:
    views = background(1, 128)
    views[:, :, 64:] = 0
    edges = LayoutDescriptor()(views)[0, : 32 * 32 * 9].reshape(32, 32, 9)
    rows, columns, orientations = np.nonzero(edges)
    assert set(columns) == {15, 16}  # the gradient is seen in the pixel on either side
    assert set(orientations) == {0}
    assert len(set(rows)) == 32


def test_a_diagonal_edge_is_shared_by_the_two_nearest_orientations() -> None:
    row, column = np.indices((128, 128))
    views = np.repeat((row + column).astype(np.uint8)[None, :, :, None], 3, axis=3)
    edges = LayoutDescriptor()(views)[0, : 32 * 32 * 9].reshape(32, 32, 9)[8, 8]
    # 45 degrees are 2.25 orientations of 20 degrees.
    np.testing.assert_allclose(edges / edges.sum(), [0, 0, 0.75, 0.25, 0, 0, 0, 0, 0], atol=1e-4)


def test_a_recolored_asset_differs_only_in_its_colors() -> None:
    red, green = background(2, 128)
    red[32:96, 32:96], green[32:96, 32:96] = (255, 0, 0), (0, 130, 0)  # of about the same luma
    before, after = LayoutDescriptor()(np.stack([red, green]))
    edges = 32 * 32 * 9 + 16 * 16 * 9
    assert before[:edges] @ after[:edges] == pytest.approx(0.75, abs=0.001)
    assert before[edges:] @ after[edges:] < 0.2


def test_an_empty_picture_is_all_zeros() -> None:
    assert not LayoutDescriptor()(background(1)).any()


def test_the_resolution_of_the_pictures_hardly_matters() -> None:
    small = np.random.default_rng(0).integers(0, 256, (1, 128, 128, 3)).astype(np.uint8)
    large = small.repeat(8, axis=1).repeat(8, axis=2)
    np.testing.assert_array_equal(LayoutDescriptor()(small), LayoutDescriptor()(large))


def bars(count: int, contrast: int) -> Pictures:
    """A grey disc with bars on it, as letters are: ``count`` of them, brighter than the disc by ``contrast``."""
    views = background(1, 256)
    row, column = np.indices((256, 256)) - 128
    views[0, row**2 + column**2 < 100**2] = 120
    for number in range(count):
        views[0, 70 + 20 * number : 80 + 20 * number, 100:156] = 120 + contrast
    return views


@pytest.mark.parametrize(
    "changes",
    [[(0, 40), (1, 40), (3, 40), (6, 40)], [(4, 0), (4, 10), (4, 30), (4, 90)]],
    ids=["more marks", "stronger marks"],
)
def test_the_score_falls_with_what_is_put_on_the_asset(changes: list[tuple[int, int]]) -> None:
    scores = [ss(bars(0, 0), bars(*change), LayoutDescriptor()) for change in changes]
    assert scores[0] == 1.0
    assert scores == sorted(scores, reverse=True)
    assert len(set(scores)) == len(scores)
    assert scores[-1] > 0.7


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    with Renderer(256) as renderer:
        yield renderer


@pytest.mark.parametrize("path", ASSETS, ids=[path.stem for path in ASSETS])
def test_another_asset_scores_far_lower_than_a_change_of_the_same(path: Path, renderer: Renderer) -> None:
    same = pictures(scene_of(path.read_bytes()), renderer)
    changed = same.copy()
    changed[:, 120:128, 100:156] //= 2
    other = pictures(scene_of(ASSETS[ASSETS.index(path) - 1].read_bytes()), renderer)
    assert ss(same, changed, LayoutDescriptor()) > 0.8
    assert ss(same, other, LayoutDescriptor()) < 0.6
