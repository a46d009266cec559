"""Text in pictures: the detector and the recogniser of PP-OCRv6 on onnxruntime.

The models are the two that the ``rapidocr`` wheel carries: PaddleOCR's small ones, converted by RapidOCR, Apache-2.0.
Its classes are left alone: they fetch what they miss from the network and write to the console. The steps around the
networks are those of Liao et al., "Real-Time Scene Text Detection with Differentiable Binarization" (AAAI 2020), and
greedy CTC decoding (Graves et al., ICML 2006), with the constants of PaddleOCR's own configuration of each model.
RapidOCR scales the detector's input by less than half; faint letters, raised ones without a colour, are then missed.

The recogniser's 18,708 characters are letters of the Latin script (not all of Vietnamese), of Greek without
accents, Chinese ones, kana, digits, punctuation and symbols.
"""

import os
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, cast

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from core.processors import available_processors

Picture = NDArray[np.uint8]
Rectangle = tuple[tuple[float, float], tuple[float, float], float]  # centre, size, degrees clockwise in the picture

# Probability that a pixel belongs to text, and its mean over a box, at least. PaddleOCR requires 0.6 of a box, to avoid
# false positives; here a box is only read and compared, and raised letters without a colour get 0.3 to 0.6 (measured).
TEXT = 0.3
UNCLIP = 1.5  # areas over perimeters; growth of boxes on each side, since the detector marks shrunken text
SPECK = 3.0  # pixels; lower boxes are no text
STRIDE = 32  # pixels; the detector takes sides that are multiples of this
LINE_HEIGHT = 48  # pixels; height of a line for the recogniser
WIDTH_STEP = 64  # pixels; lines are padded to a multiple, so that readings do not depend on the batch
BATCH = 512  # pixels of width read at once, 5 MB of output; larger ones take memory and are not faster
FILL = 128  # 8-bit grey, the recogniser's zero

# Mean and standard deviation of the colours, 0 to 255, in the order blue, green, red. The detector's are ImageNet's,
# which PaddleOCR gives in the order red, green, blue, but applies to pictures in the other one: so did the training.
DETECTOR_COLORS = ((123.675, 116.28, 103.53), (58.395, 57.12, 57.375))
RECOGNISER_COLORS = ((127.5, 127.5, 127.5), (127.5, 127.5, 127.5))

Colors = tuple[tuple[float, float, float], tuple[float, float, float]]


def available_threads() -> int:
    """``OMP_NUM_THREADS`` where it is set, as for torch; else the processors that this process has."""
    return int(os.environ.get("OMP_NUM_THREADS", 0)) or available_processors()


@dataclass(frozen=True, eq=False)
class Line:
    """A line of text in a picture.

    Attributes:
        picture: (H, W, 3) its pixels, turned to be horizontal.
        center: in the whole picture, pixels to the right and down.
        angle: of its longer side there, degrees clockwise, -90 to 90.
        confidence: mean probability of its pixels that they belong to text, 0 to 1.
    """

    picture: Picture
    center: tuple[float, float]
    angle: float
    confidence: float


class Reader:
    """Finds lines of text in pictures and reads them. Loading takes 0.2 s: make one for each process.

    CUDA is used where onnxruntime offers it. The same pictures give the same texts.

    Args:
        threads: number of onnxruntime's; None for :func:`available_threads`.
    """

    def __init__(self, threads: int | None = None) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or available_threads()
        # A thread that waits must not keep the processor that another worker needs.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        # Nearly every picture has a size of its own: a search for the fastest convolution would never pay off.
        known = {"CUDAExecutionProvider": {"cudnn_conv_algo_search": "HEURISTIC"}, "CPUExecutionProvider": {}}
        available = set(onnxruntime.get_available_providers())
        providers = [entry for entry in known.items() if entry[0] in available]
        self._detector, self._recogniser = (
            onnxruntime.InferenceSession(
                (files("rapidocr") / "models" / name).read_bytes(), options, providers=providers
            )
            for name in ("PP-OCRv6_det_small.onnx", "PP-OCRv6_rec_small.onnx")
        )
        alphabet = self._recogniser.get_modelmeta().custom_metadata_map["character"].splitlines()
        self._characters = ["", *alphabet, " "]  # CTC's blank comes first
        self._known = frozenset("".join(self._characters).casefold())

    def unknown(self, text: str) -> list[str]:
        """The characters of a text that can never be read, without regard to case; white space does not count."""
        characters = dict.fromkeys(unicodedata.normalize("NFC", text))
        return [one for one in characters if not one.isspace() and not self._known.issuperset(one.casefold())]

    def detect(self, picture: Picture) -> list[Line]:
        """Detected lines of text in an (H, W, 3) sRGB picture, each cut out and turned to be horizontal.

        A line that leans by up to 90 degrees comes out upright, any other upside down. Sorted by area times
        confidence, the most prominent line first.
        """
        height, width = picture.shape[:2]
        fill = [(0, -height % STRIDE), (0, -width % STRIDE), (0, 0)]
        probability = _run(self._detector, [np.pad(picture, fill, mode="edge")], DETECTOR_COLORS)[0, 0, :height, :width]
        text = cv2.dilate((probability > TEXT).astype(np.uint8), np.ones((2, 2), np.uint8))
        outlines, _ = cv2.findContours(text, cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
        found = []
        for outline in outlines:
            center, (across, along), angle = cast(Rectangle, cv2.minAreaRect(outline))
            if min(across, along) < SPECK:
                continue
            corners = cv2.boxPoints((center, (across, along), angle)).astype(np.float32)
            confidence = _mean_inside(probability, corners)
            if confidence < TEXT:
                continue
            grown = UNCLIP * across * along / (across + along)
            size = (across + grown, along + grown)
            found.append((confidence * size[0] * size[1], _cut_out(picture, (center, size, angle), confidence)))
        return [line for _, line in sorted(found, key=lambda entry: -entry[0])]

    def read(self, lines: Sequence[Picture]) -> list[str]:
        """Text of each (H, W, 3) sRGB picture of one upright line, at any confidence."""
        return [text for text, _ in self.read_with_confidence(lines)]

    def read_with_confidence(self, lines: Sequence[Picture]) -> list[tuple[str, float]]:
        """Text of each (H, W, 3) sRGB picture of one upright line, and the mean probability of its letters; 0 where
        there are none."""
        filled = [_fill_up(line) for line in lines]
        widths = np.array([line.shape[1] for line in filled])
        texts = [("", 0.0)] * len(lines)
        for width in np.unique(widths):
            alike = np.flatnonzero(widths == width)
            together = max(BATCH // int(width), 1)
            for rows in np.split(alike, range(together, len(alike), together)):
                steps = _run(self._recogniser, [filled[row] for row in rows], RECOGNISER_COLORS)
                for row, labels, sure in zip(rows, steps.argmax(axis=2), steps.max(axis=2), strict=True):
                    changed = np.append(True, labels[1:] != labels[:-1])
                    text = "".join(self._characters[label] for label in labels[changed])
                    letters = changed & (labels > 0)
                    texts[row] = text, float(sure[letters].mean()) if letters.any() else 0.0
        return texts


def scaled(picture: Picture, factor: float) -> Picture:
    """An (H, W, 3) sRGB picture, larger or smaller by a ``factor``."""
    if factor == 1:
        return picture
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, None, fx=factor, fy=factor, interpolation=method), dtype=np.uint8)


def _run(network: onnxruntime.InferenceSession, pictures: Sequence[Picture], colors: Colors) -> NDArray[np.float32]:
    """The output for (H, W, 3) sRGB pictures of one size, their colours brought to mean 0 and deviation 1."""
    mean, deviation = np.array(colors, dtype=np.float32)[:, None, :, None, None]
    blob = cv2.dnn.blobFromImages(pictures, swapRB=True)
    np.subtract(blob, mean, out=blob)  # in place: that of a whole picture is twelve megabytes
    np.divide(blob, deviation, out=blob)
    (output,) = network.run(None, {network.get_inputs()[0].name: blob})
    return np.asarray(output)


def _mean_inside(values: NDArray[np.float32], corners: NDArray[np.float32]) -> float:
    """The mean of (H, W) ``values`` over the pixels of a convex polygon, (N, 2) ``corners`` as x and y."""
    limit = np.array(values.shape[::-1]) - 1
    low = np.clip(np.floor(corners.min(axis=0)), 0, limit).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0)), 0, limit).astype(int)
    part = values[low[1] : high[1] + 1, low[0] : high[0] + 1]
    inside = np.zeros(part.shape, np.uint8)
    cv2.fillConvexPoly(inside, (corners - low).astype(np.int32), 1)
    return float(cv2.mean(part, inside)[0])


def _cut_out(picture: Picture, rectangle: Rectangle, confidence: float) -> Line:
    """The line in a rectangle."""
    center, (width, height), angle = rectangle
    if width < height:
        width, height, angle = height, width, angle + 90
    angle = (angle + 90) % 180 - 90
    turned = (max(round(width), 1), max(round(height), 1))
    move: NDArray[Any] = cv2.getRotationMatrix2D(center, angle, 1.0)
    move[:, 2] += np.array(turned) / 2 - np.array(center)
    pixels = cv2.warpAffine(picture, move, turned, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return Line(np.asarray(pixels), center, angle, confidence)


def _fill_up(line: Picture) -> Picture:
    """A line scaled to the recogniser's height, and with grey to the next step of width."""
    height, width = line.shape[:2]
    scaled_width = max(round(width * LINE_HEIGHT / height), 1)
    method = cv2.INTER_AREA if height > LINE_HEIGHT else cv2.INTER_CUBIC
    scaled = cv2.resize(line, (scaled_width, LINE_HEIGHT), interpolation=method)
    return np.pad(scaled, [(0, 0), (0, -scaled_width % WIDTH_STEP), (0, 0)], constant_values=FILL)
