"""A document with fewer triangles: attributes, seams and parts of what is left."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.gltf.accessors import read_accessor
from core.gltf.document import Document
from core.gltf.fewer_triangles import fewer_triangles
from core.gltf.scene import flatten, scene_of
from tests.core.gltf.builder import Builder, grid
from tests.core.gltf.rich import rich
from tests.residue import residue
from tests.validator import error_counts

SIDE = 12


def rows_of(document: Document, mesh: int = 0) -> list[dict[str, NDArray[Any]]]:
    """The rows of each primitive's attributes, and of its morph targets'."""
    found = []
    for primitive in document.json["meshes"][mesh]["primitives"]:
        maps = [primitive["attributes"], *primitive.get("targets", [])]
        found.append(
            {f"{k} {name}": read_accessor(document, a) for k, each in enumerate(maps) for name, a in each.items()}
        )
    return found


def as_set(rows: dict[str, NDArray[Any]]) -> set[bytes]:
    return {
        b"".join(values[row].tobytes() for values in rows.values()) for row in range(len(next(iter(rows.values()))))
    }


def bent(side: int = SIDE) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    positions, faces = grid(side)
    positions[:, 2] = np.sin(positions[:, 0] / 2)
    return positions, faces


def test_vertices_that_are_left_have_all_that_they_had_in_the_file() -> None:
    before = rich()
    drawn = len(flatten(before).surface.faces)
    after, count = fewer_triangles(flatten(before), drawn // 3)
    assert count <= drawn // 3
    for mesh in range(2):
        for old, new in zip(rows_of(before, mesh), rows_of(after, mesh), strict=True):
            assert old.keys() == new.keys()
            assert as_set(new) < as_set(old)
    for key in ("nodes", "skins", "animations", "materials", "scenes", "textures"):
        assert after.json[key] == before.json[key]
    assert residue(after.to_glb(), before.to_glb()) == []
    assert error_counts(after.to_glb()) <= error_counts(before.to_glb())
    assert len(scene_of(after.to_glb()).surface.faces) == count


def test_instances_count_as_often_as_they_are_drawn() -> None:
    builder = Builder()
    mesh = {"primitives": [builder.primitive(*bent())]}
    places = [{"mesh": 0, "translation": [0, 0, 9 * k]} for k in range(3)]
    document = builder.document(meshes=[mesh], nodes=places, scenes=[{"nodes": [0, 1, 2]}])
    after, count = fewer_triangles(flatten(document), 150)
    assert 120 < count <= 150
    assert len(scene_of(after.to_glb()).surface.faces) == count
    assert len(after.json["meshes"]) == 1


def test_two_materials_and_two_charts_of_a_texture_meet_without_a_crack() -> None:
    builder = Builder()
    positions, faces = bent()
    left = positions[faces].mean(axis=1)[:, 0] < SIDE / 2
    rows = np.flatnonzero(positions[:, 0] >= SIDE / 2)  # of the right half, with coordinates of their own
    number = np.full(len(positions), -1)
    number[rows] = np.arange(len(rows))
    attributes = {"TEXCOORD_0": builder.accessor(positions[:, :2] / SIDE)}
    moved = {"TEXCOORD_0": builder.accessor(positions[rows][:, [1, 0]] / SIDE)}
    upper = faces[left][:, 0] % 2 == 0  # two materials on the same rows
    first = builder.primitive(positions, faces[left][upper], **attributes)
    second = {"attributes": first["attributes"], "indices": builder.accessor(faces[left][~upper].ravel(), "<u2")}
    third = builder.primitive(positions[rows], number[faces[~left]], **moved)
    textured = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    document = builder.document(
        meshes=[{"primitives": [{**each, "material": k} for k, each in enumerate((first, second, third))]}],
        materials=[textured] * 3,
        textures=[{}],
    )
    scene = flatten(document)
    after, count = fewer_triangles(scene, 200)
    assert count < len(scene.surface.faces)
    edges = flatten(after).surface.edges
    outside = edges.ends[edges.uses == 1]
    positions_of = np.zeros((int(flatten(after).surface.weld.max()) + 1, 3))
    positions_of[flatten(after).surface.weld] = flatten(after).surface.positions
    middle = positions_of[outside].mean(axis=1)
    width = np.abs(middle).max(axis=0)
    assert ((np.abs(middle[:, 0]) > width[0] - 1e-6) | (np.abs(middle[:, 1]) > width[1] - 1e-6)).all(), "no hole inside"
    assert len(after.json["meshes"][0]["primitives"]) == 3
    assert (
        after.json["meshes"][0]["primitives"][0]["attributes"] == after.json["meshes"][0]["primitives"][1]["attributes"]
    )


def test_corners_that_only_shading_tells_apart_are_one_vertex_and_hard_edges_stay_hard() -> None:
    builder = Builder()
    positions, faces = grid(SIDE)
    corners = positions[faces.ravel()]  # every triangle has rows of its own, as in an STL
    corners[:, 2] = np.maximum(corners[:, 0] - SIDE / 2, 0)  # a fold
    triangles = corners.reshape(-1, 3, 3)
    flat = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals = np.repeat(flat / np.linalg.norm(flat, axis=1, keepdims=True), 3, axis=0)
    primitive = builder.primitive(corners, None, NORMAL=builder.accessor(normals))
    document = builder.document(meshes=[{"primitives": [primitive]}])
    after, count = fewer_triangles(flatten(document), 40)
    assert count <= 40
    entry = after.json["meshes"][0]["primitives"][0]
    at = read_accessor(after, entry["indices"]).reshape(-1, 3)
    points, shading = (read_accessor(after, entry["attributes"][name]) for name in ("POSITION", "NORMAL"))
    a, b, c = (points[at[:, corner]].astype(np.float64) for corner in range(3))
    facing = np.cross(b - a, c - a)
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    assert np.einsum("fi,fki->fk", facing, shading[at]).min() > 0.99


def test_the_same_document_becomes_the_same_bytes_and_outlines_of_what_was_are_gone() -> None:
    builder = Builder()
    primitive = builder.primitive(*bent())
    lines = builder.accessor(np.array([0, 1, 1, 2]), "<u2")
    primitive["extensions"] = {"CESIUM_primitive_outline": {"indices": lines}}
    document = builder.document(meshes=[{"primitives": [primitive]}], extensionsUsed=["CESIUM_primitive_outline"])
    one, two = (fewer_triangles(flatten(document), 90)[0].to_glb() for _ in range(2))
    assert one == two
    assert "CESIUM" not in json.dumps(Document.from_glb(one).json)
