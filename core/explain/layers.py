"""The steps of a placement as a model with layers, and as pictures."""

from dataclasses import dataclass
from io import BytesIO

import numpy as np
from PIL import Image

from core.arrays import Float, Int
from core.explain.explain import Explanation
from core.formats.assemble import assemble
from core.formats.assembly import Assembly, Instance
from core.formats.polygons import Material, PolygonMesh
from core.geometry.boxes import Boxes
from core.gltf.colors import hex_linear
from core.gltf.scene import scene_of
from core.placement.rejection import REASONS, Stage
from core.rendering.cavity import cavity
from core.rendering.preview import contact_sheet
from core.rendering.renderer import Frame, Renderer

PICTURE = 640  # pixels a side of what is rendered; half of it in the pictures
CLAY = Material("asset", (0.8, 0.8, 0.8, 1.0))
NEAR = 0.75  # radius of a picture of one mark over its width
LIFT = 0.06  # size-30 units that a frame stands before its box


@dataclass(frozen=True, eq=False)
class Layer:
    """Boxes of one step.

    Attributes:
        name: of its node in the model, and of its picture.
        title: for people.
        color: "#rrggbb" of its frames.
        boxes: size-30 units.
        rim: width of a frame over the height of its box; a half fills it.
    """

    name: str
    title: str
    color: str
    boxes: Boxes
    rim: float = 0.14


COLORS = {
    Stage.FREE: "#a855f7",
    Stage.COVERED: "#f59e0b",
    Stage.WHOLE: "#ec4899",
    Stage.OPAQUE: "#14b8a6",
    Stage.SMOOTH: "#ef4444",
    Stage.OPEN: "#8b5cf6",
    Stage.THICK: "#92400e",
    Stage.SEEN: "#64748b",
}


def layers(explained: Explanation) -> list[Layer]:
    """The steps from the candidates to the marks; those that have no boxes are left out."""
    trace = explained.trace
    found = [
        Layer("candidates", "Candidates, before fine-tuning", "#2563eb", trace.left(Stage.CANDIDATES)),
        Layer("fitted", "After fine-tuning", "#0891b2", trace.left(Stage.ALIGNED)),
        *(
            Layer(f"dropped-{stage}", f"Dropped: {REASONS[stage][0]}", color, trace.dropped(stage))
            for stage, color in COLORS.items()
        ),
        Layer("places", "Passed every filter", "#16a34a", trace.left(Stage.SEEN)),
        Layer("refused", "Chosen, and could not be cut", "#dc2626", explained.refused, rim=0.3),
        Layer("marks", "Marks", "#d40f63", explained.marks, rim=0.5),
    ]
    return [layer for layer in found if len(layer.boxes)]


def model(explained: Explanation, shown: list[Layer]) -> bytes:
    """GLB of the asset in grey clay, in its own coordinates, and a node with the frames of each layer."""
    surface = explained.surface
    bodies = [_body(surface.to_world(surface.positions), surface.faces, CLAY)]
    for layer in shown:
        corners, faces = _frames(layer.boxes, layer.rim)
        red, green, blue = hex_linear(layer.color).tolist()
        bodies.append(_body(surface.to_world(corners), faces, Material(layer.name, (red, green, blue, 1.0))))
    names = ["asset", *(layer.name for layer in shown)]
    document = assemble(Assembly(bodies, names, [Instance(name, number) for number, name in enumerate(names)]))
    for material in document.json["materials"]:
        material["doubleSided"] = True
    return document.to_glb()


def pictures(explained: Explanation, shown: list[Layer]) -> dict[str, bytes]:
    """PNG of eight sides of the asset with each layer, by its name.

    Raises:
        MeshmarkError: ``rendering_unavailable``.
    """
    with Renderer(PICTURE) as renderer:
        found = {}
        for layer in shown:
            renderer.load(scene_of(model(explained, [layer])))
            found[layer.name] = contact_sheet(renderer)
        return found


def close_ups(explained: Explanation) -> list[bytes]:
    """PNG of each mark in the marked asset, head-on and from near by.

    Raises:
        MeshmarkError: ``rendering_unavailable``.
    """
    if explained.scene is None:
        return []
    boxes, found = explained.marks, []
    with Renderer(PICTURE) as renderer:
        renderer.load(explained.scene)
        for center, axes, size in zip(boxes.center, boxes.axes, boxes.size, strict=True):
            x, y, z = center.tolist()
            renderer.aim(Frame((x, y, z), NEAR * float(size[0])))
            picture = Image.fromarray(cavity(*renderer.render_with_depth(axes[2], axes[1]))).reduce(2)
            file = BytesIO()
            picture.save(file, format="PNG")
            found.append(file.getvalue())
    return found


def _body(positions: Float, faces: Int, material: Material) -> PolygonMesh:
    return PolygonMesh(
        positions=positions,
        corners=faces.ravel(),
        sizes=np.full(len(faces), 3),
        group=np.zeros(len(faces), dtype=np.int64),
        materials=(material,),
    )


def _frames(boxes: Boxes, rim: float) -> tuple[Float, Int]:
    """Frames round the front of each box, their ``rim`` over its height: (V, 3) and (F, 3)."""
    half = boxes.size[:, :2] / 2
    width = rim * boxes.size[:, 1]
    outer = half[:, None] * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    inner = (half - width[:, None])[:, None] * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    flat = np.concatenate([outer, inner], axis=1)
    front = boxes.center + (boxes.size[:, 2, None] / 2 + LIFT) * boxes.axes[:, 2]
    corners = front[:, None] + np.einsum("bki,bij->bkj", flat, boxes.axes[:, :2])
    quads = np.array([[side, (side + 1) % 4, 4 + (side + 1) % 4, 4 + side] for side in range(4)])
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    faces = (8 * np.arange(len(boxes))[:, None, None] + triangles).reshape(-1, 3)
    return corners.reshape(-1, 3), faces
