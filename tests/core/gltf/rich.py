"""A GLB with a little of everything that an edit has to leave alone."""

from io import BytesIO

import numpy as np
from PIL import Image

from core.gltf.document import Document
from tests.core.gltf.builder import Builder, grid


def rich() -> Document:
    """Two bent sheets, one skinned and morphing, one drawn twice, once mirrored; with an animation, two scenes, a
    texture, sparse data, a camera, a light, extras, and an extension and properties that nobody knows."""
    positions, faces = grid(6)
    positions = (positions - 3) * np.array([1, 0.5, 1], dtype=np.float32)
    count = len(positions)
    builder = Builder()
    normals = np.tile(np.array([[0, 0, 1]], dtype=np.float32), (count, 1))
    attributes = {
        "NORMAL": builder.accessor(normals),
        "TANGENT": builder.accessor(np.tile(np.array([[1, 0, 0, 1]], dtype=np.float32), (count, 1))),
        "TEXCOORD_0": builder.accessor(positions[:, :2] / 6 + 0.5),
        "COLOR_0": builder.accessor(np.full((count, 4), 200), "<u1", normalized=True),
        "JOINTS_0": builder.accessor(np.tile([0, 1, 0, 0], (count, 1)), "<u1"),
        "WEIGHTS_0": builder.accessor(np.tile([0.75, 0.25, 0, 0], (count, 1))),
    }
    moved = np.zeros((count, 3), dtype=np.float32)
    moved[:, 2] = np.abs(positions[:, 0]) / 10
    primitive = {
        **builder.primitive(positions, faces, **attributes),
        "material": 0,
        "targets": [{"POSITION": builder.accessor(moved)}],
    }
    other = {**builder.primitive(positions + np.array([0, 5, 0], dtype=np.float32), faces), "material": 1}
    sparse = {
        "count": 2,
        "indices": {"bufferView": builder.view(np.array([1, 3], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": builder.view(np.full((2, 3), 0.25, "<f4").tobytes())},
    }
    replaced = positions + np.array([0, 5, 0], dtype=np.float32)
    replaced[[1, 3]] = 0.25
    bounds = {"min": replaced.min(axis=0).tolist(), "max": replaced.max(axis=0).tolist()}
    builder.json["accessors"][other["attributes"]["POSITION"]] |= {"sparse": sparse, **bounds}
    bind = builder.accessor(np.tile(np.eye(4, dtype=np.float32).ravel(), (2, 1)))
    times, turns = builder.accessor([0.0, 1.0]), builder.accessor(np.array([[0, 0, 0, 1], [0, 0.6, 0, 0.8]]))
    builder.json["accessors"][times] |= {"min": [0], "max": [1]}
    picture = BytesIO()
    Image.new("RGB", (4, 4), (200, 120, 40)).save(picture, format="PNG")
    image = builder.view(picture.getvalue())
    return builder.document(
        meshes=[{"name": "skin", "primitives": [primitive], "weights": [0.5]}, {"primitives": [other]}],
        nodes=[
            {"name": "root", "children": [1, 2, 3, 4]},
            {"mesh": 0, "skin": 0, "extras": {"seller": 7}},
            {"name": "hip", "children": [5]},
            {"mesh": 1, "translation": [0, 0, 4], "scale": [1, -1, 1]},
            {"mesh": 1, "rotation": [0, 0.7071068, 0, 0.7071068], "extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"name": "knee", "translation": [0, 0.5, 0]},
            {"name": "eye", "camera": 0},
        ],
        scenes=[{"nodes": [0]}, {"name": "empty", "nodes": [6], "extras": ["kept"]}],
        skins=[{"joints": [2, 5], "inverseBindMatrices": bind}],
        animations=[
            {
                "channels": [{"sampler": 0, "target": {"node": 5, "path": "rotation"}}],
                "samplers": [{"input": times, "output": turns}],
            }
        ],
        materials=[
            {"name": "cloth", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "doubleSided": True},
            {"name": "lead", "pbrMetallicRoughness": {"metallicFactor": 0.5}},
        ],
        textures=[{"source": 0}],
        images=[{"bufferView": image, "mimeType": "image/png"}],
        extensionsUsed=["KHR_lights_punctual", "EXT_nobody_knows"],
        extensions={
            "KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 3.0}]},
            "EXT_nobody_knows": {"values": [1, {"a": None}]},
        },
        extras={"shop": "A & Ω"},
        cameras=[{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}],
    )
