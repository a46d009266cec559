"""The stages that mark an asset: from its bytes to the watermarked GLB.

Those that need torch and the geometry libraries import them when they start: these take more than a second and a
quarter of a gigabyte to load, and files that cannot be read do not need them. A process that runs the engine again and
again calls :func:`core.preload.preload` first.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from core.arrays import Bool, Float
from core.artwork.advice import plainer, subject
from core.artwork.layouts import Layouts
from core.artwork.lettering import layouts_of
from core.budgets import Budgets
from core.choices import FileFormat, Profile
from core.embossing.mesh import WorkingMesh
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.formats.format import Format, OutputFile
from core.formats.registry import export_format
from core.geometry.boxes import Boxes
from core.geometry.directions import view_directions
from core.gltf.builder import Builder
from core.gltf.document import Document
from core.gltf.edit import SurfaceEdit
from core.gltf.prune import unreferenced_bytes
from core.gltf.scene import flatten
from core.gltf.textures import undecoded_textures
from core.gltf.validate import is_beside
from core.gltf.write import write
from core.labels.declaration import Declaration
from core.labels.write import WrittenLabel, write_label
from core.notices import Notice, NoticeCode
from core.parameters import Parameters
from core.stages import Asset, Candidates, Embossed, Ground, Output, Run

if TYPE_CHECKING:
    from core.analysis.facts import SurfaceFacts
    from core.geometry.spatial import SpatialIndex


def read(data: bytes, budgets: Budgets, wanted: FileFormat = FileFormat.GLB) -> Asset:
    """Recognise a file, read it, and analyse its surface.

    Raises:
        MeshmarkError: as :func:`core.formats.admission.admit`, :func:`core.formats.registry.export_format`,
            :func:`core.formats.admission.document_of` and :func:`core.gltf.scene.flatten`.
    """
    admitted = admit(data, budgets)
    export_format(wanted, admitted.format)  # refuses what is not written before any work
    document = document_of(admitted, budgets)
    scene = flatten(document)
    notices = [*document.warnings]
    if unreferenced := unreferenced_bytes(document):
        notices.append(
            Notice(
                NoticeCode.UNREFERENCED_DATA,
                f"Nothing in this file refers to {unreferenced:,} bytes of it; they are not in the result, "
                "where they could be a copy without watermarks.",
                "Nothing needs to be done; exporting the asset anew leaves such bytes out.",
            )
        )
    beside = [image["uri"] for image in document.json.get("images", []) if is_beside(image)]
    if beside:
        notices.append(
            Notice(
                ErrorCode.EXTERNAL_REFERENCE,
                f"The asset's textures lie in other files ({', '.join(beside[:3])}); they were not opened. "
                "Where marks stand, and what pictures and figures show, is reckoned without them.",
                "Keep these files beside the result, or embed them before the upload.",
            )
        )

    from core.analysis.analyse import analyse

    return Asset(data, admitted.format, scene, analyse(scene), tuple(notices))


def letter(run: Run) -> Layouts:
    """Turn text, logo or QR code into outlines, the text in each way of setting it.

    Raises:
        MeshmarkError: as :func:`core.artwork.lettering.layouts_of`.
    """
    request = run.request
    layouts = layouts_of(request.parameters, request.font, request.logo)
    run.faces = layouts.artworks[0].faces
    if request.font is not None and len(run.faces) > 1:
        others = ", ".join(face.name for face in run.faces[1:])
        run.notices.append(
            Notice(
                NoticeCode.FONT_SUBSTITUTED,
                f"The font that was sent lacks letters of this text; they are set in {others}.",
                "Send a font that has all letters, or leave these out, if the marks must be in one font.",
            )
        )
    return layouts


def place(asset: Asset, layouts: Layouts, run: Run) -> Candidates:
    """Find the boxes that may carry the text: on opaque faces, or on see-through ones where no box fits on these.

    Raises:
        MeshmarkError: ``no_placement`` and as :func:`core.analysis.regions.regions`.
    """
    from core.analysis.analyse import HIDING
    from core.analysis.facts import SurfaceFacts
    from core.analysis.features import feature_regions
    from core.analysis.heads import on_head
    from core.analysis.regions import regions
    from core.analysis.saliency import saliency
    from core.analysis.skinning import skin_deformation
    from core.analysis.symmetry import mirror_plane
    from core.analysis.texture import texture_saliency

    scene, analysis, parameters = asset.scene, asset.analysis, run.request.parameters
    requested = regions(scene, analysis.surface, parameters)
    salient = saliency(analysis.surface, parameters.seed)
    samples = analysis.surface, salient.points, salient.face
    texture, skin = texture_saliency(scene, *samples), skin_deformation(scene, *samples)
    plane = mirror_plane(salient.points, salient.normals)
    head = on_head(scene, skin, salient.face, plane)
    features = feature_regions(analysis.surface, salient, texture, plane, head)
    facts = SurfaceFacts(salient, texture, skin, requested, features)
    run.notices += undecoded_textures(scene.document)
    rng = np.random.default_rng(parameters.seed)

    def on(faces: Bool, index: "SpatialIndex", opaque: float) -> Candidates:
        return _place_on(asset, facts, layouts, (requested.within(faces), index, opaque), rng, run)

    try:
        return on(analysis.opaque, analysis.index, HIDING)
    except MeshmarkError as error:
        if error.code is not ErrorCode.NO_PLACEMENT or (analysis.cuttable == analysis.opaque).all():
            raise
    found = on(analysis.cuttable, analysis.glazed, 0.0)
    run.notices.append(
        Notice(
            NoticeCode.SEE_THROUGH_SURFACE,
            f"Nothing opaque has room for the {subject(layouts)}; it stands on what is seen through, where it may be "
            "hard to see.",
            f"Make the materials opaque, or use {plainer(layouts)}.",
        )
    )
    return found


def _place_on(
    asset: Asset,
    facts: "SurfaceFacts",
    layouts: Layouts,
    ground: tuple[Bool, "SpatialIndex", float],
    rng: np.random.Generator,
    run: Run,
) -> Candidates:
    """The boxes on some faces; ``ground`` is these (F,), the index for view rays to them, and their least opacity."""
    from core.analysis.facts import Carrier
    from core.analysis.opacity import opacity
    from core.placement.context import build_context
    from core.placement.place import place as place_boxes
    from core.placement.watch import UNWATCHED

    (faces, index, opaque), surface = ground, asset.analysis.surface
    looks = opacity(asset.scene, surface, faces) if opaque else None
    carrier = Carrier(surface, index, faces, asset.analysis.component, looks)
    request = run.request
    watch = request.watch or UNWATCHED
    context = build_context(carrier, facts, layouts, request.parameters, rng, request.options, watch)
    return Candidates(context, place_boxes(context, rng, run.progress), opaque, rng)


def emboss(asset: Asset, candidates: Candidates, run: Run) -> Embossed:
    """Cut the best choice of boxes into the surface.

    Raises:
        MeshmarkError: ``no_placement`` where every cut was refused.
    """
    from core.analysis.contrast import CODES, CONTRAST, looks_of_letters
    from core.embossing.islands import letters_of
    from core.embossing.marks import emboss_marks

    context, parameters = candidates.context, run.request.parameters
    scene, surface, index = asset.scene, asset.analysis.surface, context.carrier.index
    options = CODES if context.layouts.logo == "qr" else CONTRAST
    assert parameters.profile is not None
    letters = letters_of(
        context.layouts,
        lambda boxes: looks_of_letters(scene, surface, index, boxes, parameters.palette, options),
        parameters.profile,
    )
    mesh = whole(asset, candidates.ground)
    done = emboss_marks(mesh, context, candidates.placement, letters, candidates.rng, run.progress)
    return Embossed(mesh, letters, done.placement, done.marks, done.refusals)


def _doubts(ground: Ground, embossed: Embossed, parameters: Parameters) -> list[Notice]:
    """The notices that text is small, and that letters are flat against the wish."""
    from core.placement.legibility import legible_height, too_low

    notices, marks = list[Notice](), embossed.marks.values()
    highest = ground.layouts.line_height(np.concatenate([mark.box.size for mark in marks])).max()
    if highest < legible_height(bool(parameters.palette)) * (1 - 1e-6):
        widest = max(float(mark.box.size[0, 0]) for mark in marks)
        capped = parameters.size is not None and widest >= parameters.size * (1 - 1e-6)
        notices.append(too_low(highest, bool(ground.layouts.artworks[0].label), capped))
    if flat := sum(mark.cut != "delaunay" for mark in marks) if parameters.profile is Profile.SOFT else 0:
        notices.append(
            Notice(
                NoticeCode.FLAT_LETTERS,
                f"{flat} of {len(marks)} marks have flat letters: this far from the origin the file's 32-bit "
                "coordinates are too coarse for the contours of soft ones.",
                "Move the model to the origin of its own coordinates if letters should be soft.",
            )
        )
    return notices


def whole(asset: Asset, ground: Ground) -> WorkingMesh:
    """The surface before any mark."""
    analysis = asset.analysis
    return WorkingMesh(analysis.surface, ground.carrier.cuttable, analysis.coincident, analysis.resolution)


def write_model(asset: Asset, ground: Ground, embossed: Embossed, run: Run) -> Output:
    """The model, checked and published: marks that no viewer would draw are removed, and it is written again.

    Raises:
        MeshmarkError: ``no_placement`` where no mark is left.
    """
    from core.analysis.contrast import low_contrast, unreadable_codes
    from core.embossing.copies import unmarked
    from core.embossing.unmarked import unmarked_parts
    from core.placement.label_height import too_small

    analysis, parameters = asset.analysis, run.request.parameters
    embossed, edit, output = drawn_alone(asset, ground, embossed, parameters)
    alone = parameters.preview_model is not None and parameters.preview_model.alone
    run.notices += _doubts(ground, embossed, parameters)
    run.notices += [] if alone else unmarked(output.copies)
    if ground.facts is not None:
        marked = analysis.surface.face_primitive[edit.source_face[np.unique(edit.mark, return_index=True)[1]]]
        samples, index = ground.facts.saliency, ground.carrier.index
        left = unmarked_parts(asset.scene, analysis.surface, samples, index, marked)
        run.notices += [left] if left else []
    looks = [mark.look for mark in embossed.marks.values()]
    run.notices += low_contrast(looks) if parameters.palette else _hidden_by_texture(embossed, ground)
    run.notices += unreadable_codes(looks) if ground.layouts.logo == "qr" else []
    run.notices += output.label.notices if output.label else []
    if parameters.rule is not None:
        heights = label_heights_of(embossed, ground)
        run.notices += too_small(heights, parameters.rule)
        output = replace(output, heights=heights)
    if not alone:
        run.publish("model", output.file.data)
    return output


def drawn_alone(
    asset: Asset, ground: Ground, embossed: Embossed, parameters: Parameters
) -> tuple[Embossed, SurfaceEdit, Output]:
    """The marks that a viewer draws, the edit that they are, and the file with these alone.

    Raises:
        MeshmarkError: ``no_placement`` where there are none.
    """
    from core.embossing.drawn import drawn_marks

    analysis = asset.analysis
    while True:
        edit, count = embossed.mesh.edit(), len(embossed.marks)
        output = _written(asset, parameters, embossed, edit)
        drawn = drawn_marks(edit, count, analysis.surface, analysis.resolution, output.scene, ground.opaque)
        if drawn.all():
            return embossed, edit, output
        unseen = {box for box, seen in zip(embossed.marks, drawn.tolist(), strict=True) if not seen}
        embossed = _without(unseen, asset, ground, embossed, parameters)


def label_heights_of(embossed: Embossed, ground: Ground) -> Float:
    """(24,) see :func:`core.placement.label_height.label_heights`."""
    from core.placement.label_height import label_heights

    boxes = Boxes.concat(*(mark.box for mark in embossed.marks.values()))
    visible = embossed.placement.visible[list(embossed.marks), : len(view_directions()[0])]
    return label_heights(boxes, ground.layouts.line_height(boxes.size), visible, ground.carrier.surface.radius)


def write_label_alone(asset: Asset, run: Run) -> Output:
    """The asset with a machine-readable label and no mark, published.

    Raises:
        MeshmarkError: ``invalid_parameters`` without a label.
    """
    run.request.parameters.require_label()
    label = _label(asset.scene.document, run.request.parameters)
    assert label is not None
    builder = Builder(asset.scene.document)
    builder.json = label.json
    scene = flatten(builder.to_document())
    output = Output(None, [], [], scene, OutputFile(Format.GLB, scene.document.to_glb()), label)
    run.notices += label.notices
    run.publish("model", output.file.data)
    return output


def _label(document: Document, parameters: Parameters) -> WrittenLabel | None:
    """The label that a request asks for, in a document."""
    if parameters.label is None:
        return None
    return write_label(document.json, parameters.label, parameters.text, parameters.declaration or Declaration())


def _hidden_by_texture(embossed: Embossed, ground: Ground) -> list[Notice]:
    """The notice that the texture hides letters in the surface's own colour; of QR codes there is one already."""
    from core.placement.legibility import hard_to_read
    from core.placement.objective import contrast

    plain = [mark.box for mark in embossed.marks.values() if mark.look.style.color is None]
    texture = None if ground.facts is None else ground.facts.texture
    if texture is None or not plain or ground.layouts.logo == "qr":
        return []
    boxes = Boxes.concat(*plain)
    under = texture.pairs_in_boxes(boxes)
    _, _, busy = texture.under(under)
    seen = contrast(texture.color_under(under), busy, (), embossed.placement.objective)
    return hard_to_read(ground.layouts.line_height(boxes.size), seen)


def _without(unseen: set[int], asset: Asset, ground: Ground, embossed: Embossed, parameters: Parameters) -> Embossed:
    """The marks embossed anew, without those in the boxes ``unseen``.

    Raises:
        MeshmarkError: ``no_placement`` where none is left.
    """
    from core.embossing.refusal import Refusal

    refusals = embossed.refusals | dict.fromkeys(sorted(unseen), Refusal.UNDRAWN)
    kept = {box: mark for box, mark in embossed.marks.items() if box not in unseen}
    done = embossed_again(asset, ground, replace(embossed, marks=kept, refusals=refusals), parameters)
    if not done.marks:
        raise MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            f"All {len(done.refusals)} marks that fit on this asset would be culled, clear or covered by its own "
            "materials: no viewer would draw them.",
            "Check which sides of the asset its materials show, and their alpha.",
        )
    return done


def embossed_again(asset: Asset, ground: Ground, embossed: Embossed, parameters: Parameters) -> Embossed:
    """The marks of ``embossed`` that can be cut into the surface of an ``asset``, which has none yet."""
    from core.embossing.emboss import Mark
    from core.embossing.marks import emboss_boxes

    mesh, marks, refusals = whole(asset, ground), dict[int, Mark](), dict(embossed.refusals)
    if embossed.marks:
        boxes = Boxes.concat(*(mark.box for mark in embossed.marks.values()))
        looks = [mark.look for mark in embossed.marks.values()]
        outcomes = emboss_boxes(mesh, boxes, looks, embossed.letters, parameters, ground.carrier.index)
        for box, outcome in zip(embossed.marks, outcomes, strict=True):
            if isinstance(outcome, Mark):
                marks[box] = outcome
            else:
                refusals[box] = outcome
    return replace(embossed, mesh=mesh, marks=marks, refusals=refusals)


def _written(asset: Asset, parameters: Parameters, embossed: Embossed, edit: SurfaceEdit) -> Output:
    """The model with these marks, which are the ``edit``, and with those of its other scenes and levels of detail."""
    from core.embossing.copies import AssetMarks, mark_copies

    surface = asset.analysis.surface
    boxes = Boxes.concat(*(mark.box for mark in embossed.marks.values()))
    looks = [mark.look for mark in embossed.marks.values()]
    styles = [look.style for look in looks]
    edit = asset.analysis.with_file_winding(edit)
    model = write(asset.scene, edit, styles, asset.tints)
    coloring = asset.tints.of_marks(asset.scene, edit, styles)
    marks = AssetMarks(surface, boxes, looks, embossed.letters, parameters)
    model, copies = mark_copies(model, marks)
    document = Document.from_glb(model)
    del model  # its bytes are in the document, and the file takes as many
    if label := _label(document, parameters):
        document.json = label.json
    scene = flatten(document)
    return Output(embossed, coloring, copies, scene, OutputFile(Format.GLB, scene.document.to_glb()), label)
