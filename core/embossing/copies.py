"""The marks of an asset once more, in the other copies of it that its file holds."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from core.analysis.analyse import analyse
from core.analysis.contrast import Look
from core.choices import UnmarkedCopies
from core.embossing.emboss import Mark
from core.embossing.islands import Letters
from core.embossing.marks import emboss_boxes
from core.embossing.mesh import WorkingMesh
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from core.gltf.copies import Copy, find_copies, leave_out, scene_of
from core.gltf.document import Document
from core.gltf.hierarchy import hidden_nodes, scene_nodes
from core.gltf.write import write
from core.notices import Notice, NoticeCode
from core.parameters import Parameters

Outcome = Literal["marked", "shared", "unmarked", "left_out"]


@dataclass(frozen=True)
class MarkedCopy:
    """Outcome of embossing a copy.

    Attributes:
        copy: nodes or meshes beside the asset.
        watermarks: number of the asset's marks in it, without those of meshes that it shares with the asset.
        outcome: "shared" where its meshes are the asset's own, "unmarked" where it is kept as it is.
    """

    copy: Copy
    watermarks: int
    outcome: Outcome


@dataclass(frozen=True, eq=False)
class AssetMarks:
    """The marks of an asset, to be embossed once more.

    Attributes:
        surface: the asset's, whose size-30 frame the boxes are in.
        boxes: of its marks.
        looks: of their letters.
        letters: in each layout.
        parameters: relief, mode, and the policy for copies that cannot be marked.
    """

    surface: Surface
    boxes: Boxes
    looks: Sequence[Look]
    letters: Letters
    parameters: Parameters


def mark_copies(model: bytes, marks: AssetMarks) -> tuple[bytes, list[MarkedCopy]]:
    """Embosses the asset's marks into every other copy of it in its file.

    Nodes that draw a mesh which the default scene shows are as it is; hidden nodes, levels of detail, other scenes and
    nodes in no scene are embossed where the same boxes fit. Copies that no box fits into, and meshes that no node
    draws, are left out, unless the parameters keep them; hidden nodes stay, for they may be shown later.

    Args:
        model: the marked GLB.
        marks: the marks in it.

    Returns:
        The GLB, and the outcome for each copy.
    """
    document = Document.from_glb(model)
    copies = find_copies(document)
    if not copies:
        return model, []
    drawn = _meshes(document, set(scene_nodes(document)) - hidden_nodes(document))
    found: list[MarkedCopy] = []
    for copy in copies:
        meshes = _meshes(document, copy.nodes)
        if meshes and meshes <= drawn:
            found.append(MarkedCopy(copy, 0, "shared"))
            continue
        own = tuple(node for node in copy.nodes if document.entry("nodes", node)["mesh"] not in drawn)
        document, count = _embossed(document, replace(copy, nodes=own), marks)
        kept = marks.parameters.unmarked_copies is UnmarkedCopies.KEEP or copy.kind == "hidden_nodes"
        left: Outcome = "unmarked" if kept else "left_out"
        found.append(MarkedCopy(copy, count, "marked" if count else "shared" if meshes & drawn else left))
    lost = [item.copy for item in found if item.outcome == "left_out"]
    if lost:
        document = leave_out(document, lost)
    return document.to_glb(), found


def _meshes(document: Document, nodes: Collection[int]) -> set[int]:
    entries = [document.entry("nodes", node) for node in nodes]
    return {entry["mesh"] for entry in entries if "mesh" in entry}


def _embossed(document: Document, copy: Copy, marks: AssetMarks) -> tuple[Document, int]:
    """The document with the marks that fit into a copy, and their number."""
    if not copy.nodes:
        return document, 0
    try:
        scene = scene_of(document, copy)
        scene = replace(scene, surface=scene.surface.in_frame_of(marks.surface))
        analysis = analyse(scene)
    except MeshmarkError as error:  # a copy that cannot be read or has no faces counts as one without fitting boxes
        if error.code is ErrorCode.DEVICE_UNAVAILABLE:
            raise
        return document, 0
    mesh = WorkingMesh(analysis.surface, analysis.cuttable, analysis.coincident, analysis.resolution)
    index = analysis.index if analysis.opaque.any() else analysis.glazed
    outcomes = list(emboss_boxes(mesh, marks.boxes, marks.looks, marks.letters, marks.parameters, index))
    styles = [outcome.look.style for outcome in outcomes if isinstance(outcome, Mark)]
    if not styles:
        return document, 0
    return Document.from_glb(write(scene, analysis.with_file_winding(mesh.edit()), styles)), len(styles)


def unmarked(copies: Sequence[MarkedCopy]) -> list[Notice]:
    """The warnings about copies that carry no marks: those left out, and those kept as they are."""
    beside = "What the file holds beside what its default scene shows is"
    warnings = []
    for outcome, what, remedy in (
        (
            "left_out",
            "left out of the result, since no watermark fits into it",
            "Send it as an asset of its own, or ask for `unmarked_copies: keep`.",
        ),
        (
            "unmarked",
            "in the result without watermarks",
            "Send it as an asset of its own; what is not hidden is left out without `unmarked_copies: keep`.",
        ),
    ):
        names = [_named(item.copy) for item in copies if item.outcome == outcome]
        if names:
            warnings.append(
                Notice(
                    NoticeCode.UNMARKED_COPIES,
                    f"{beside} {what}: {', '.join(names[:5])}"
                    + (f" and {len(names) - 5} more." if len(names) > 5 else "."),
                    remedy,
                )
            )
    return warnings


def _named(copy: Copy) -> str:
    kind = copy.kind.replace("_", " ")
    return f"{kind} {copy.name}" if copy.name else kind
