"""Linear blend skinning at the default pose (glTF 2.0 specification, section 3.7.3)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.errors import ErrorCode, MeshmarkError
from core.geometry.products import product
from core.gltf.accessors import dequantize, read_accessor
from core.gltf.document import Document, malformed, typed


def influence_sets(attributes: dict[str, Any]) -> int:
    """Number of JOINTS_n/WEIGHTS_n pairs of a primitive."""
    sets = 0
    while f"JOINTS_{sets}" in attributes and f"WEIGHTS_{sets}" in attributes:
        sets += 1
    return sets


def read_influences(document: Document, attributes: dict[str, Any]) -> tuple[Int, Float]:
    """Joints (V, K) and weights (V, K) of a primitive, K = 4 per set, ordered by joint, each row summing to 1.

    The order makes rows that list the same influences differently equal. Weights are normalised, and a row without
    any follows its first joint, as viewers do. A slot without weight names joint 0, whatever it names in the file:
    exporters write one past the last joint there.
    """
    sets = range(influence_sets(attributes))
    joints = np.hstack([read_accessor(document, attributes[f"JOINTS_{n}"]) for n in sets]).astype(np.int64)
    stored = [read_accessor(document, attributes[f"WEIGHTS_{n}"]) for n in sets]
    weights = np.hstack([dequantize(values, {"normalized": True}) for values in stored])  # integer weights always are
    weights = np.clip(weights, 0.0, None)
    weights[~weights.any(axis=1), 0] = 1.0
    joints[weights == 0] = 0
    order = np.argsort(joints, axis=1, kind="stable")
    joints, weights = np.take_along_axis(joints, order, 1), np.take_along_axis(weights, order, 1)
    total = np.zeros((len(weights), 1))
    for column in weights.T:  # one by one: zero weights at other places must not change the rounding
        total[:, 0] += column
    return joints, weights / total


@dataclass(frozen=True, eq=False)
class Skin:
    """A skin at the default pose.

    Attributes:
        joints: (J,) int64, the nodes that move it.
        matrices: (J, 3, 4) bind pose -> world.
    """

    joints: Int
    matrices: Float


def read_skin(document: Document, skin_index: int, worlds: Float) -> Skin:
    """A skin; ``worlds`` is (N, 4, 4), one matrix per node.

    Raises:
        MeshmarkError: ``malformed_file`` for joints that do not exist, and for broken matrices.
    """
    skin = document.entry("skins", skin_index)
    joints = typed(skin, "joints", list)
    if not joints or any(type(joint) is not int or not 0 <= joint < len(worlds) for joint in joints):
        raise malformed(f"skins[{skin_index}] does not list existing joints.")
    nodes = np.array(joints, dtype=np.int64)
    world = worlds[nodes]
    if "inverseBindMatrices" in skin:
        columns = read_accessor(document, skin["inverseBindMatrices"]).astype(np.float64)
        if columns.shape[1:] != (16,) or len(columns) < len(joints) or not np.isfinite(columns).all():
            raise malformed(f"skins[{skin_index}] has too few or broken inverse bind matrices.")
        world = product(world, columns[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1))
    return Skin(nodes, np.ascontiguousarray(world[:, :3]))


def blend(joints: Int, weights: Float, matrices: Float) -> Float:
    """(V, 3, 4) weighted sums of joint ``matrices`` (J, 3, 4); the same influences always round the same.

    Raises:
        MeshmarkError: ``index_out_of_range`` for a joint that the skin lacks.
    """
    if joints.max(initial=0) >= len(matrices):
        raise MeshmarkError(
            ErrorCode.INDEX_OUT_OF_RANGE,
            f"A vertex follows joint {joints.max()}, but its skin has {len(matrices)} joints.",
            "Export the asset again; its skin is damaged.",
        )
    blended = np.zeros((len(joints), 3, 4))
    for joint, weight in zip(joints.T, weights.T, strict=True):
        blended += weight[:, None, None] * matrices[joint]
    return blended


def merge(joints: Int, weights: Float, keep: int) -> tuple[Int, Float]:
    """The ``keep`` strongest influences of each row, renormalised.

    Args:
        joints: (N, L) joint indices, repetitions allowed: their weights add up. L >= keep.
        weights: (N, L), may be zero or slightly negative.
        keep: number of influences to keep.

    Returns:
        (N, keep) joints in descending order of weight, without repetitions; an unused slot is joint 0, weight 0.
    """
    order = np.argsort(joints, axis=1, kind="stable")
    joints = np.take_along_axis(joints, order, 1)
    weights = np.clip(np.take_along_axis(weights, order, 1), 0.0, None)
    starts = np.ones(joints.shape, dtype=bool)
    starts[:, 1:] = joints[:, 1:] != joints[:, :-1]
    run = np.cumsum(starts, axis=1) - 1
    row = np.broadcast_to(np.arange(len(joints))[:, None], joints.shape)
    merged = np.zeros(joints.shape)
    np.add.at(merged, (row, run), weights)
    owner = np.zeros(joints.shape, dtype=np.int64)
    owner[row, run] = joints
    strongest = np.argsort(-merged, axis=1, kind="stable")[:, :keep]
    joints, weights = np.take_along_axis(owner, strongest, 1), np.take_along_axis(merged, strongest, 1)
    weights /= weights.sum(axis=1, keepdims=True)
    return np.where(weights > 0, joints, 0), weights


def quantize_weights(weights: Float, dtype: np.dtype[Any]) -> NDArray[Any]:
    """(N, K) weights that sum to 1 in a component type; integers sum exactly to its maximum."""
    if dtype.kind == "f":
        return np.asarray(weights, dtype)
    maximum = int(np.iinfo(dtype).max)
    scaled = weights * maximum
    floor = np.floor(scaled).astype(np.int64)
    missing = maximum - floor.sum(axis=1)
    # The missing units go to the largest remainders.
    rank = np.argsort(np.argsort(floor - scaled, axis=1, kind="stable"), axis=1, kind="stable")
    return np.asarray(floor + (rank < missing[:, None]), dtype)
