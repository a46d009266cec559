"""Which of the reported marks a viewer draws, judged by the triangles of the marked file alone.

Each mark is looked at head-on, ray by ray from just above its letters. A ray sees the first triangle that a viewer
draws: its front, or either side where the material is double-sided, of a node that is shown, and not clear. A mark is
drawn where rays that meet what the mark is made of see it there, and not something behind it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

from core.arrays import Float, Int
from tests.glb_file import INSTANCING, GlbFile, Json

ACROSS, UP = 40, 12  # rays
ENOUGH = 0.9  # of the rays that meet a mark
CLEAR = 0.05  # alpha below which nobody sees a surface
SAME = 1e-6  # of the asset's size, within which two points are one


@dataclass(frozen=True, eq=False)
class Shown:
    """Triangles that one primitive of one node (or of one instance of it) has in the world.

    Attributes:
        corners: (F, 3, 3).
        front: 1 where the winding of the world's corners is that of the front, else -1.
        visible: no node above it is hidden.
        double_sided: its material is.
        alpha: (F, 3) of factor and vertex colour, at the corners.
        texture: (h, w) alpha of the base colour's image; None where it has none.
        uv: (F, 3, 2) where the image is looked up.
        cutoff: alpha below which nothing is drawn.
    """

    corners: Float
    front: float
    visible: bool
    double_sided: bool
    alpha: Float
    texture: Float | None
    uv: Float
    cutoff: float


def undrawn(marked: bytes, marks: Sequence[Json], original: bytes | None = None) -> list[Any]:
    """The ids of the marks of a report that no viewer draws.

    Args:
        marked: a GLB.
        marks: the ``watermarks`` of its report.
        original: the GLB it was made of, by which a mark's own triangles are told from the asset's; without it all
            triangles within a mark's box count as its own.
    """
    parts = list(shown(GlbFile(marked)))
    old = None if original is None else _centroids(list(shown(GlbFile(original))))
    return [mark["id"] for mark in marks if share_seen(parts, mark, old) < ENOUGH]


def _centroids(parts: list[Shown]) -> cKDTree:
    return cKDTree(np.concatenate([part.corners.mean(axis=1) for part in parts]))


def share_seen(parts: list[Shown], mark: Json, old: cKDTree | None = None) -> float:
    """Of the rays at a mark that meet its own triangles, the share that see them; 0 where none meets any."""
    center, up, normal = (np.array(mark[key], float) for key in ("center", "up", "normal"))
    side = np.cross(up, normal)
    half, lift = np.array(mark["size"], float) / 2, abs(mark["relief"])
    top = half[2] + 2 * lift
    x, y = np.meshgrid((np.arange(ACROSS) + 0.5) / ACROSS * 2 - 1, (np.arange(UP) + 0.5) / UP * 2 - 1)
    starts = np.column_stack([x.ravel() * half[0], y.ravel() * half[1]])
    own = np.full(len(starts), np.inf)  # depth below `top` of the first triangle of the mark
    seen = np.full(len(starts), np.inf)  # and of the first that is drawn
    for part in parts:
        local = (part.corners - center) @ np.column_stack([side, up, normal])
        low, high = local.min(axis=1), local.max(axis=1)
        near = np.all((low[:, :2] <= half[:2]) & (high[:, :2] >= -half[:2]), axis=1) & (low[:, 2] <= top)
        which = np.flatnonzero(near & (high[:, 2] >= -top))
        if not len(which):
            continue
        new = np.ones(len(which), bool)
        if old is not None:
            extent = np.linalg.norm(half)
            new = old.query(part.corners[which].mean(axis=1))[0] > SAME * extent * 10
        for at, is_new in zip(which.tolist(), new, strict=True):
            hit, weights = _meets(starts, local[at])
            if not len(hit):
                continue
            depth = top - weights @ local[at][:, 2]
            below = depth >= 0
            hit, weights, depth = hit[below], weights[below], depth[below]
            if is_new:
                own[hit] = np.minimum(own[hit], depth)
            if _is_drawn(part, at, normal):
                clear = _alpha(part, at, weights) < max(part.cutoff, CLEAR)
                seen[hit[~clear]] = np.minimum(seen[hit[~clear]], depth[~clear])
    met = own <= 2 * top
    return float((np.abs(seen[met] - own[met]) <= 0.25 * lift).mean()) if met.any() else 0.0


def _meets(points: Float, corners: Float) -> tuple[Int, Float]:
    """Which of the points (N, 2) lie under a triangle (3, 3), and their (n, 3) weights of its corners."""
    (ax, ay), (bx, by), (cx, cy) = corners[:, :2]
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if abs(area) < 1e-15:
        return np.zeros(0, np.int64), np.zeros((0, 3))
    x, y = points.T
    first = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area
    second = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area
    weights = np.column_stack([first, second, 1 - first - second])
    hit = np.flatnonzero((weights >= 0).all(axis=1))
    return hit, weights[hit]


def _is_drawn(part: Shown, face: int, towards: Float) -> bool:
    a, b, c = part.corners[face]
    return bool(part.visible and (part.double_sided or part.front * (np.cross(b - a, c - a) @ towards) > 0))


def _alpha(part: Shown, face: int, weights: Float) -> Float:
    alpha = weights @ part.alpha[face]
    if part.texture is not None:
        uv = weights @ part.uv[face]
        height, width = part.texture.shape
        column, row = (np.floor((uv % 1) * [width, height])).astype(int).T
        alpha = alpha * part.texture[np.minimum(row, height - 1), np.minimum(column, width - 1)]
    return np.asarray(alpha)


def shown(file: GlbFile) -> Iterator[Shown]:
    """All triangles of the default scene, each time that they are drawn, hidden ones as such."""
    nodes = file.entries("nodes")
    worlds, visible = _worlds(file)
    for number in worlds:
        node = nodes[number]
        if "mesh" not in node:
            continue
        mesh = file.entries("meshes")[node["mesh"]]
        for instance in _instances(file, node):
            world = worlds[number] @ instance
            for primitive in mesh["primitives"]:
                rows = file.triangles(primitive) if primitive.get("mode", 4) in (4, 5, 6) else np.zeros((0, 3), int)
                if len(rows) and "POSITION" in primitive["attributes"]:
                    weights = node["weights"] if "weights" in node else mesh.get("weights", [])
                    points = _placed(file, primitive, weights, node, world, worlds)
                    yield _shown(file, primitive, rows, points, np.linalg.det(world[:3, :3]), visible[number])


def _worlds(file: GlbFile) -> tuple[dict[int, Float], dict[int, bool]]:
    nodes, scenes = file.entries("nodes"), file.entries("scenes")
    children = {child for node in nodes for child in node.get("children", [])}
    roots = [number for number in range(len(nodes)) if number not in children]
    if scenes:
        roots = scenes[file.json.get("scene", 0)].get("nodes", [])
    worlds: dict[int, Float] = {}
    visible: dict[int, bool] = {}
    pending = [(root, np.eye(4), True) for root in roots]
    while pending:
        number, above, is_visible = pending.pop()
        node = nodes[number]
        said = node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible", True)
        worlds[number], visible[number] = above @ _matrix(node), is_visible and said
        pending += [(child, worlds[number], visible[number]) for child in node.get("children", [])]
    return worlds, visible


def _matrix(node: Json) -> Float:
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    return _transform(
        node.get("translation", [0, 0, 0]), node.get("rotation", [0, 0, 0, 1]), node.get("scale", [1] * 3)
    )


def _transform(translation: Any, rotation: Any, scale: Any) -> Float:
    x, y, z, w = np.array(rotation, float) / np.linalg.norm(rotation)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= scale
    matrix[:3, 3] = translation
    return matrix


def _instances(file: GlbFile, node: Json) -> list[Float]:
    attributes = node.get("extensions", {}).get(INSTANCING, {}).get("attributes")
    if not attributes:
        return [np.eye(4)]
    values = {name: file.numbers(number) for name, number in attributes.items()}
    count = len(next(iter(values.values())))
    defaults = {"TRANSLATION": [0, 0, 0], "ROTATION": [0, 0, 0, 1], "SCALE": [1, 1, 1]}
    columns = [values.get(name, np.tile(np.array(value, float), (count, 1))) for name, value in defaults.items()]
    return [_transform(*row) for row in zip(*columns, strict=True)]


def _placed(
    file: GlbFile, primitive: Json, weights: list[float], node: Json, world: Float, worlds: dict[int, Float]
) -> Float:
    """(V, 3) vertices in the world: morphed by the default weights, then moved by the skin or the node."""
    attributes = primitive["attributes"]
    points = file.numbers(attributes["POSITION"])
    for target, weight in zip(primitive.get("targets", []), weights, strict=False):
        if weight and "POSITION" in target:
            points = points + weight * file.numbers(target["POSITION"])
    if "skin" not in node or "JOINTS_0" not in attributes:
        return np.asarray(points @ world[:3, :3].T + world[:3, 3])
    skin = file.entries("skins")[node["skin"]]
    bind = np.tile(np.eye(4), (len(skin["joints"]), 1, 1))
    if "inverseBindMatrices" in skin:
        bind = file.numbers(skin["inverseBindMatrices"])[: len(bind)].reshape(-1, 4, 4).transpose(0, 2, 1)
    joints = np.stack([worlds[joint] for joint in skin["joints"]]) @ bind
    sets = sorted(name.removeprefix("JOINTS_") for name in attributes if name.startswith("JOINTS_"))
    index = np.hstack([file.read(attributes[f"JOINTS_{each}"]) for each in sets]).astype(int)
    share = np.hstack([file.numbers(attributes[f"WEIGHTS_{each}"]) for each in sets])
    share = share / share.sum(axis=1, keepdims=True)
    moved = np.einsum("vj,vjab->vab", share, joints[index])
    return np.asarray(np.einsum("vab,vb->va", moved[:, :3, :3], points) + moved[:, :3, 3])


def _shown(file: GlbFile, primitive: Json, rows: Int, points: Float, determinant: float, visible: bool) -> Shown:
    attributes = primitive["attributes"]
    material = file.entries("materials")[primitive["material"]] if "material" in primitive else {}
    mode, surface = material.get("alphaMode", "OPAQUE"), material.get("pbrMetallicRoughness", {})
    alpha, texture, uv = np.ones((len(rows), 3)), None, np.zeros((len(rows), 3, 2))
    if mode != "OPAQUE":
        alpha = alpha * surface.get("baseColorFactor", [1, 1, 1, 1])[3]
        colors = file.numbers(attributes["COLOR_0"]) if "COLOR_0" in attributes else np.ones((len(points), 3))
        if colors.shape[1] == 4:
            alpha = alpha * colors[:, 3][rows]
        if "baseColorTexture" in surface:
            texture, uv = _texture(file, surface["baseColorTexture"], attributes, rows)
    cutoff = material.get("alphaCutoff", 0.5) if mode == "MASK" else 0.0
    sign, sided = (-1.0 if determinant < 0 else 1.0), bool(material.get("doubleSided", False))
    return Shown(points[rows], sign, visible, sided, alpha, texture, uv, cutoff)


def _texture(file: GlbFile, said: Json, attributes: dict[str, int], rows: Int) -> tuple[Float | None, Float]:
    moved = said.get("extensions", {}).get("KHR_texture_transform", {})
    name = f"TEXCOORD_{moved.get('texCoord', said.get('texCoord', 0))}"
    source = file.entries("textures")[said["index"]].get("source")
    if name not in attributes or source is None or "bufferView" not in file.entries("images")[source]:
        return None, np.zeros((len(rows), 3, 2))
    uv = file.numbers(attributes[name])
    turn = moved.get("rotation", 0.0)
    cos, sin = np.cos(turn), np.sin(turn)
    uv = uv * moved.get("scale", [1, 1]) @ np.array([[cos, -sin], [sin, cos]]) + moved.get("offset", [0, 0])
    data = file.views[file.entries("images")[source]["bufferView"]]
    image = np.asarray(Image.open(BytesIO(data)).convert("RGBA"))
    return image[:, :, 3] / 255.0, uv[rows]
