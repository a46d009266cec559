"""Poses an animated GLB: the channels of an animation evaluated at a time, written into its nodes."""

import copy
from typing import Any

import numpy as np

from core.arrays import Float
from core.gltf.accessors import dequantize, read_accessor
from core.gltf.document import Document


def duration(document: Document, animation: int) -> float:
    """Seconds until the last key."""
    samplers = document.json["animations"][animation]["samplers"]
    return max(float(_values(document, sampler["input"]).max()) for sampler in samplers)


def posed(document: Document, animation: int, time: float) -> Document:
    """The document with every animated node property (glTF 2.0, section 3.11) at ``time`` seconds."""
    json = copy.deepcopy(document.json)
    channels = json["animations"][animation]["channels"]
    for channel in channels:
        target = channel["target"]
        if "node" not in target:
            continue
        value = _sample(document, json["animations"][animation]["samplers"][channel["sampler"]], time, target["path"])
        node = json["nodes"][target["node"]]
        node.pop("matrix", None)
        node[target["path"]] = value.tolist()
    return Document(json, document.binary)


def _sample(document: Document, sampler: dict[str, Any], time: float, path: str) -> Float:
    keys = _values(document, sampler["input"]).ravel()
    values = _values(document, sampler["output"])
    interpolation = sampler.get("interpolation", "LINEAR")
    values = values.reshape(len(keys), 3, -1) if interpolation == "CUBICSPLINE" else values.reshape(len(keys), -1)
    time = float(np.clip(time, keys[0], keys[-1]))
    before = int(np.clip(np.searchsorted(keys, time, side="right") - 1, 0, max(len(keys) - 2, 0)))
    if len(keys) == 1 or interpolation == "STEP":
        flat = values[:, 1] if interpolation == "CUBICSPLINE" else values
        return np.asarray(flat[int(np.clip(np.searchsorted(keys, time, side="right") - 1, 0, len(keys) - 1))])
    span = keys[before + 1] - keys[before]
    share = (time - keys[before]) / span
    if interpolation == "CUBICSPLINE":
        _, start, leave = values[before]
        arrive, end, _ = values[before + 1]
        square, cube = share**2, share**3
        result = (2 * cube - 3 * square + 1) * start + span * (cube - 2 * square + share) * leave
        result = result + (3 * square - 2 * cube) * end + span * (cube - square) * arrive
    else:
        start, end = values[before], values[before + 1]
        if path == "rotation" and start @ end < 0:
            end = -end
        result = (1 - share) * start + share * end  # nlerp for rotations: close enough between close keys
    return np.asarray(result / np.linalg.norm(result) if path == "rotation" else result)


def _values(document: Document, number: int) -> Float:
    return dequantize(read_accessor(document, number), document.json["accessors"][number])
