"""Turns of the nodes of an asset against each other, by its own animations."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.errors import MeshmarkError
from core.geometry.products import product
from core.gltf.accessors import dequantize, read_accessor
from core.gltf.document import Document
from core.gltf.hierarchy import transforms
from core.gltf.scene import Scene

POSES = 24  # of all animations together
MOST = 1000  # nodes that are compared: their pairs are held at once; of more, none is known to move
DIGITS = 6  # decimals of the cosine between two turns: equal on all processors


def turns(scene: Scene, nodes: Int) -> Float | None:
    """(N, N) greatest angle, radians, by which the ``nodes`` (N,) of a scene turn against each other: over poses of all
    animations, from the pose in which the asset is drawn.

    Only rotations count, those at keys, and what lies between them on the shorter way; channels that are not well
    formed move nothing. ``None`` where nothing is animated, so that every joint may turn one day.
    """
    poses = list(_poses(scene.document))
    if not poses or len(nodes) > MOST:
        return None
    rest = _worlds(scene, _at_rest(scene.document))
    least = np.ones((len(nodes), len(nodes)))
    for pose in poses:
        turned = product(_worlds(scene, pose)[nodes], rest[nodes].transpose(0, 2, 1)).reshape(len(nodes), 9)
        least = np.minimum(least, (product(turned, turned.T) - 1) / 2)
    return np.asarray(np.arccos(np.clip(np.round(least, DIGITS), -1, 1)))


def _at_rest(document: Document) -> Float:
    """(N, 4) the rotations of all nodes, as quaternions x, y, z, w; those of nodes with a matrix are 0, 0, 0, 1."""
    nodes = document.json.get("nodes", [])
    return np.array([node.get("rotation", (0, 0, 0, 1)) for node in nodes], dtype=np.float64).reshape(-1, 4)


def _poses(document: Document) -> Iterator[Float]:
    """The rotations of all nodes, as in :func:`_at_rest`, at even keys of every animation that turns any."""
    rest = _at_rest(document)
    moving = [channels for one in document.json.get("animations", []) if (channels := list(_channels(document, one)))]
    for channels in moving[:POSES]:
        poses = np.repeat(rest[None], max(POSES // len(moving), 2), axis=0)
        times = max((keys for _, keys, _ in channels), key=len)
        times = times[np.linspace(0, len(times) - 1, len(poses)).round().astype(np.int64)]
        for node, keys, values in channels:
            poses[:, node] = np.stack([np.interp(times, keys, column) for column in values.T], axis=1)
        yield from poses


def _channels(document: Document, animation: dict[str, Any]) -> Iterator[tuple[int, Float, Float]]:
    """Node, times (K,) and unit quaternions (K, 4) of the well-formed rotations of an animation, each quaternion on the
    side of the one before."""
    samplers = animation.get("samplers", [])
    for channel in animation.get("channels", []):
        try:
            target, sampler = channel["target"], samplers[channel["sampler"]]
            if target["path"] != "rotation" or not 0 <= target["node"] < len(document.json["nodes"]):
                continue
            keys = _values(document, sampler["input"]).reshape(-1)
            values = _values(document, sampler["output"]).reshape(len(keys), -1, 4)
        except (MeshmarkError, LookupError, TypeError, ValueError):
            continue
        middle = values[:, values.shape[1] // 2]  # of a cubic spline: its tangents are round it
        length = np.linalg.norm(middle, axis=1, keepdims=True)
        if not (np.isfinite(keys).all() and (np.diff(keys) >= 0).all() and np.isfinite(length).all() and length.all()):
            continue
        middle = middle / length
        flipped = np.where(np.einsum("ki,ki->k", middle[1:], middle[:-1]) < 0, -1.0, 1.0)
        yield target["node"], keys, middle * np.concatenate([[1.0], np.cumprod(flipped)])[:, None]


def _values(document: Document, accessor: int) -> Float:
    return dequantize(read_accessor(document, accessor), document.json["accessors"][accessor]).astype(np.float64)


def _worlds(scene: Scene, rotations: Float) -> NDArray[np.float64]:
    """(N, 3, 3) rotations of all nodes in the world by their own ``rotations`` (N, 4). Scales, and matrices, are left
    out: they turn all that is below a node alike."""
    unit = rotations / np.maximum(np.linalg.norm(rotations, axis=1, keepdims=True), np.finfo(float).tiny)
    zero, one = np.zeros((len(unit), 3)), np.ones((len(unit), 3))
    worlds = transforms(zero, unit, one)[:, :3, :3].copy()
    for node in scene.nodes:  # parents come before their children
        for child in node.children:
            worlds[child] = product(worlds[node.index], worlds[child])
    return worlds
