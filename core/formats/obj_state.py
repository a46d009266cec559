"""The objects, groups and smoothing groups of an OBJ, and those of the faces of its watermarked surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Int
from core.formats.drawing import Drawing
from core.formats.polygons import PolygonMesh
from core.formats.text import Lines
from core.geometry.grouping import float_words, group_rows
from core.geometry.triangulation import triangulate
from core.gltf.accessors import read_values
from core.gltf.edit import SurfaceEdit
from core.gltf.scene import Scene
from core.gltf.vertices import cut_primitives

KEYWORDS = (b"o", b"g", b"s")


@dataclass(frozen=True, eq=False)
class States:
    """The lines ``o``, ``g`` and ``s`` that hold for faces.

    Attributes:
        texts: of each state; the first has none.
        of_face: (P,) int64, the state of each face.
    """

    texts: list[tuple[bytes, ...]]
    of_face: Int


def read_states(lines: Lines) -> States:
    """The states of an OBJ's faces."""
    is_face = lines.keyword(b"f")
    kinds = np.zeros(len(lines), np.int64)
    for number, word in enumerate(KEYWORDS):
        kinds[lines.keyword(word)] = number + 1
    switches = np.flatnonzero(kinds)
    now: list[bytes] = [b""] * len(KEYWORDS)
    numbers: dict[tuple[bytes, ...], int] = {tuple(now): 0}
    states = [0]
    for line in switches.tolist():
        now[kinds[line] - 1] = lines[line].rstrip()
        states.append(numbers.setdefault(tuple(now), len(numbers)))
    at = np.searchsorted(switches, np.flatnonzero(is_face))
    return States(list(numbers), np.asarray(states, np.int64)[at])


def states_of_faces(
    states: States, body: PolygonMesh, drawing: Drawing, before: Scene, edit: SurfaceEdit | None
) -> Int:
    """(T,) the state of each face of a drawing, part after part.

    A face that is still there is known by its corners; a new one has the state of the face that it was cut from.

    Args:
        states: of the file.
        body: its mesh.
        drawing: of the result, its positions those of the accessors.
        before: the scene of the file.
        edit: what was changed in it.
    """
    triangles, polygon = triangulate(body.positions, body.corners, body.sizes)
    with np.errstate(over="ignore", invalid="ignore"):
        positions = (body.positions - drawing.parts[0].matrix[:3, 3]).astype(np.float32)
    cuts = cut_primitives(before, edit) if edit is not None else []
    file, whole, *others = _keys(
        [
            (positions, body.corners[triangles]),
            (_rows(before), before.surface.faces),
            *((part.positions.astype(np.float32), part.faces) for part in drawing.parts),
            *((cut.local, np.arange(len(cut.local)).reshape(-1, 3)) for cut in cuts),
        ]
    )
    drawn, made = others[: len(drawing.parts)], others[len(drawing.parts) :]
    state = np.full(max(int(keys.max(initial=-1)) for keys in (file, whole, *others)) + 1, -1)
    state[file[::-1]] = states.of_face[polygon][::-1]  # the first of faces that lie on each other
    of_source = state[whole]
    for cut, keys in zip(cuts, made, strict=True):
        assert edit is not None
        new = state[keys] < 0
        state[keys[new]] = of_source[edit.source_face[cut.triangles[new]]]
    return np.asarray(np.maximum(state[np.concatenate(drawn)], 0))


def _rows(scene: Scene) -> NDArray[np.float32]:
    """(V, 3) the accessor rows of the scene's surface."""
    rows = np.zeros(scene.surface.positions.shape, np.float32)
    for drawn in scene.primitives:
        values = read_values(scene.document, drawn.primitive.attributes["POSITION"])
        rows[drawn.first_vertex : drawn.first_vertex + len(values)] = values
    return rows


def _keys(blocks: list[tuple[NDArray[np.float32], Int]]) -> list[Int]:
    """For each block of points (V, 3) and faces (T, 3) a number (T,) of each face: equal where the corners are."""
    label = group_rows(float_words(np.concatenate([points for points, _ in blocks])))
    start = np.cumsum([0, *(len(points) for points, _ in blocks)])
    corners = [label[faces + first] for (_, faces), first in zip(blocks, start[:-1].tolist(), strict=True)]
    keys = group_rows(np.sort(np.concatenate(corners), axis=1).astype(np.uint32))
    return np.split(keys, np.cumsum([len(faces) for _, faces in blocks])[:-1])
