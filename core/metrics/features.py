"""Feature vectors of pictures: ResNet50 where its weights are installed, else a hand-made descriptor."""

from pathlib import Path
from typing import Protocol

import numpy as np
import onnxruntime
from numpy.typing import NDArray
from PIL import Image

from core import models
from core.metrics.recognition import available_threads
from core.rendering.renderer import BACKGROUND

Pictures = NDArray[np.uint8]
Features = NDArray[np.float32]


class Extractor(Protocol):
    """Extractor of (V, D) features, whose cosines measure similarity, from (V, S, S, 3) uint8 sRGB pictures."""

    name: str

    def __call__(self, pictures: Pictures) -> Features:
        """One row of features for each picture."""


def extractor(folder: Path | None = None) -> Extractor:
    """The best extractor available; its ``name`` belongs beside every figure made with it.

    Args:
        folder: of the models; None for :func:`core.models.cache_folder`.

    Raises:
        MeshmarkError: ``model_unavailable`` where the weights are there but damaged.
    """
    weights = models.find(models.RESNET50.name, folder)
    return LayoutDescriptor() if weights is None else ResNet50(weights)


class ResNet50:
    """The 2048 pooled activations below the classifier of ResNet50 (He et al., CVPR 2016), trained on ImageNet.

    The ONNX model zoo's ``resnet50-v1-12-int8``. Its graph declares only the 1000 class scores as output, and
    onnxruntime hands out nothing undeclared, so the pooled activations are declared too: see :func:`_declare_output`.
    They are quantised with zero point 0; their scale, 0.0234, is left out, since a cosine does not depend on it.

    Pictures are scaled to 224 px, not cropped as for photographs: the asset reaches the frame. Integer convolutions
    exist for onnxruntime's CPU only; on CUDA each would be a round trip, so CUDA is not used here.

    Args:
        weights: the file, already checked.
        threads: that onnxruntime computes with; None for :func:`available_threads`.
    """

    name = models.RESNET50.name

    INPUT = "data"
    POOLED = "resnetv17_pool1_fwd_quantized"
    SIZE = 224
    BATCH = 8  # pictures, 5 MB of input; larger ones are not faster
    MEAN = np.array([0.485, 0.456, 0.406], dtype=np.float32)
    DEVIATION = np.array([0.229, 0.224, 0.225], dtype=np.float32)

    def __init__(self, weights: Path, threads: int | None = None) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or available_threads()
        options.log_severity_level = 3
        # Threads that wait must not keep a processor busy on which another worker computes.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        model = _declare_output(weights.read_bytes(), self.POOLED)
        self._session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])

    def __call__(self, pictures: Pictures) -> Features:
        """(V, 2048), in quantisation steps."""
        batches = [pictures[first : first + self.BATCH] for first in range(0, len(pictures), self.BATCH)]
        return np.concatenate([self._features(batch) for batch in batches])

    def _features(self, batch: Pictures) -> Features:
        scaled = _resized(batch, self.SIZE, Image.Resampling.BILINEAR).astype(np.float32) / np.float32(255)
        normal = (scaled - self.MEAN) / self.DEVIATION
        (pooled,) = self._session.run([self.POOLED], {self.INPUT: np.ascontiguousarray(normal.transpose(0, 3, 1, 2))})
        return np.asarray(pooled, dtype=np.float32).reshape(len(batch), -1)


def _declare_output(model: bytes, tensor: str) -> bytes:
    """A serialised ONNX model with one more of its tensors among its outputs.

    Two serialised messages behind one another are their merger, in which repeated fields are joined (protobuf's
    encoding guide, "Last One Wins"): it takes ``ModelProto{graph=7 {output=12 {name=1}}}`` at the end and no parser.
    """
    field = tensor.encode()
    for number in (1, 12, 7):
        field = bytes([number << 3 | 2, len(field)]) + field  # lengths under 128 take one byte
    return model + field


class LayoutDescriptor:
    """Layout of oriented edges and of colours: the descriptor where ResNet50 is not installed.

    A picture is averaged down to 128 px. From its luma (0.299, 0.587, 0.114) come central differences, whose
    magnitudes are voted into 9 unsigned orientations, split linearly between the two nearest, in cells of 4 and of
    8 px: histograms of oriented gradients (Dalal & Triggs, CVPR 2005). Each cell's histogram h becomes
    h / sqrt(\\|h\\|^2 + (0.02 n)^2), n its number of pixels, so that shallow relief counts and noise does not. With
    them goes the mean colour of 8x8 patches less the background's: the surroundings say nothing about the asset.

    Each of the three parts gets unit length and then a weight, so that the cosine of two descriptors is
    1/2 cos(4 px edges) + 1/4 cos(8 px edges) + 1/4 cos(colours). Marks of the usual size leave 0.93 to 1, other assets
    0.2 to 0.5. It compares watermarks of one asset; its values are not those of a trained network.
    """

    name = "hog-color-layout"

    SIZE = 128
    CELL = 4
    ORIENTATIONS = 9
    FLOOR = 0.02  # luma a pixel; gradients well below do not count
    PATCHES = 8
    LUMA = np.array([0.299, 0.587, 0.114], dtype=np.float32)

    def __call__(self, pictures: Pictures) -> Features:
        """(V, 11712): 32x32x9 and 16x16x9 edges, 8x8x3 colours. A picture of nothing but background is all zeros."""
        count = len(pictures)
        pixels = _resized(pictures, self.SIZE, Image.Resampling.BOX).astype(np.float32)
        fine = self._histograms(np.einsum("...c,c->...", pixels, self.LUMA / np.float32(255)))
        cells = self.SIZE // self.CELL // 2
        coarse = fine.reshape(count, cells, 2, cells, 2, self.ORIENTATIONS).sum(axis=(2, 4))
        patch = self.SIZE // self.PATCHES
        colors = pixels.reshape(count, self.PATCHES, patch, self.PATCHES, patch, 3).mean(axis=(2, 4))
        colors -= round(255 * BACKGROUND)
        parts = [
            (self._balanced(fine, self.CELL), 1 / 2),
            (self._balanced(coarse, 2 * self.CELL), 1 / 4),
            (colors, 1 / 4),
        ]
        return np.concatenate([_unit(part.reshape(count, -1)) * np.sqrt(weight) for part, weight in parts], axis=1)

    def _histograms(self, luma: Features) -> Features:
        """(V, S/4, S/4, 9) sums of gradient magnitude by cell and orientation of (V, S, S) pictures."""
        bins, cells = self.ORIENTATIONS, self.SIZE // self.CELL
        across = luma[:, 1:-1, 2:] - luma[:, 1:-1, :-2]
        down = luma[:, 2:, 1:-1] - luma[:, :-2, 1:-1]
        picture, row, column = np.nonzero((across != 0) | (down != 0))  # the background is the larger part
        across, down = across[picture, row, column], down[picture, row, column]
        magnitude = np.hypot(across, down)
        orientation = np.arctan2(down, across) * (bins / np.pi) % bins
        lower = orientation.astype(np.int64)
        share = orientation - lower
        cell = ((picture * cells + (row + 1) // self.CELL) * cells + (column + 1) // self.CELL) * bins
        histograms = np.bincount(
            np.concatenate([cell + lower % bins, cell + (lower + 1) % bins]),
            np.concatenate([magnitude * (1 - share), magnitude * share]),
            len(luma) * cells * cells * bins,
        )
        return histograms.reshape(len(luma), cells, cells, bins).astype(np.float32)

    def _balanced(self, histograms: Features, cell: int) -> Features:
        energy = np.square(histograms).sum(axis=-1, keepdims=True) + (self.FLOOR * cell**2) ** 2
        balanced: Features = histograms / np.sqrt(energy)
        return balanced


def _resized(pictures: Pictures, size: int, filtering: Image.Resampling) -> Pictures:
    return np.stack([np.asarray(Image.fromarray(picture).resize((size, size), filtering)) for picture in pictures])


def _unit(vectors: Features) -> Features:
    length: Features = np.linalg.norm(vectors, axis=1, keepdims=True).astype(np.float32)
    length[length == 0] = 1
    return vectors / length
