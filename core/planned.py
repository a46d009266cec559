"""The stages of a run that takes the places of an earlier one: a plan is made, and followed with another text."""

from hashlib import sha256

import numpy as np

from core import __version__
from core.analysis.contrast import OWN, Look
from core.analysis.facts import Carrier
from core.analysis.regions import regions
from core.artwork.layouts import Layouts
from core.artwork.lettering import layouts_of
from core.artwork.room import LEAST, roomiest, set_in, suiting
from core.choices import Direction
from core.embossing.emboss import Mark
from core.embossing.islands import letters_of
from core.embossing.marks import emboss_boxes, nothing_embossed
from core.embossing.refusal import Refusal
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.gltf.edit import Style
from core.marking import whole
from core.parameters import Parameters
from core.placement.objective import Placement
from core.plan import VIEWS, Plan, PlannedMark
from core.stages import Asset, Embossed, Ground, Run
from core.validation import shortened


def plan_of(asset: Asset, ground: Ground, embossed: Embossed, parameters: Parameters) -> Plan:
    """The plan of what was embossed, which was made for these ``parameters``."""
    surface, placement = asset.analysis.surface, embossed.placement
    return Plan(
        engine=__version__,
        asset=sha256(asset.data).hexdigest(),
        parameters=parameters,
        offset=tuple(surface.offset.tolist()),
        scale=float(surface.scale),
        opaque=ground.opaque,
        marks=tuple(
            PlannedMark(
                center=tuple(mark.box.center[0].tolist()),
                axes=mark.box.axes[0].tolist(),
                size=tuple(mark.box.size[0].tolist()),
                line_height=float(ground.layouts.line_height(mark.box.size)[0]),
                color=mark.look.style.color,
                glows=mark.look.style.glows,
                contrast=mark.look.contrast,
                lighter=mark.look.lighter,
                loss=float(placement.loss[box]),
                roughness=float(placement.roughness[box]),
                views=tuple(np.flatnonzero(placement.visible[box, :VIEWS]).tolist()),
            )
            for box, mark in embossed.marks.items()
        ),
    )


def roomy_layouts(layouts: Layouts, run: Run) -> tuple[str, Layouts]:
    """The text that needs most room, of that of the run and those of its copies, and the layouts to search places for.

    Args:
        layouts: of the run's own text.
        run: with the request. Of copies those are left out whose text cannot be set: they fail by themselves.
    """
    request = run.request
    parameters, texts = request.parameters, [request.parameters.text, *request.copies]
    wrap, longest = parameters.wrap, layouts
    while (text := roomiest(texts, wrap)) != parameters.text:
        try:
            longest = layouts_of(parameters.model_copy(update={"text": text}), request.font, request.logo)
            break
        except MeshmarkError:
            texts.remove(text)
    return text, suiting(longest, texts, wrap) if parameters.direction is Direction.HORIZONTAL else longest


def follow(asset: Asset, layouts: Layouts, plan: Plan, run: Run) -> tuple[Ground, Embossed]:
    """Cut the text of the run into the places of a plan; those that refuse it stay empty.

    Raises:
        MeshmarkError: ``invalid_request``, the plan is of another file, or of a version that saw this one otherwise;
            ``text_too_long``; ``no_placement`` where every cut was refused; as :func:`core.analysis.regions.regions`.
    """
    analysis, parameters = asset.analysis, run.request.parameters
    _require_its_own(plan, asset)
    boxes, used = _fitted(plan, layouts, parameters.text)
    opaque, index = analysis.opaque, analysis.index
    if plan.opaque == 0:
        opaque, index = analysis.cuttable, analysis.glazed
    within = regions(asset.scene, analysis.surface, parameters).within(opaque)
    ground = Ground(Carrier(analysis.surface, index, within, analysis.component), used, plan.opaque)

    looks = [Look(Style(mark.color, mark.glows), mark.contrast, mark.lighter) for mark in plan.marks]
    assert parameters.profile is not None
    letters = letters_of(used, lambda asked: [OWN] * len(asked), parameters.profile)
    mesh, marks, refusals = whole(asset, ground), dict[int, Mark](), dict[int, Refusal]()
    for number, outcome in enumerate(emboss_boxes(mesh, boxes, looks, letters, parameters, index)):
        if isinstance(outcome, Mark):
            marks[number] = outcome
        else:
            refusals[number] = outcome
        run.progress((number + 1) / len(boxes))
    if not marks:
        raise nothing_embossed(refusals, used, parameters)
    return ground, Embossed(mesh, letters, _placement(plan, boxes), marks, refusals)


def _require_its_own(plan: Plan, asset: Asset) -> None:
    surface = asset.analysis.surface
    if plan.asset != sha256(asset.data).hexdigest():
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "The plan is of another file: its places are not on this one.",
            "Take the plan of a job with this very file, or mark the file anew.",
        )
    if plan.scale != float(surface.scale) or plan.offset != tuple(surface.offset.tolist()):
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            f"The plan was made by version {plan.engine}, which measured this file otherwise than {__version__} does.",
            "Mark the file anew, and take the plan of that job.",
        )


def _fitted(plan: Plan, layouts: Layouts, text: str) -> tuple[Boxes, Layouts]:
    """The places of a plan, as large as the text is in them, and the layouts that it has there.

    Raises:
        MeshmarkError: ``text_too_long``.
    """
    places = Boxes(*(np.array([getattr(mark, name) for mark in plan.marks]) for name in ("center", "axes", "size")))
    planned = np.array([mark.line_height for mark in plan.marks])
    sizes, used = set_in(layouts, places.size[:, :2], planned)
    share = 0.0 if not sizes.all() else float((used.line_height(sizes) / planned).min())
    if share < LEAST:
        raise MeshmarkError(
            ErrorCode.TEXT_TOO_LONG,
            f"The text {shortened(text)!r} needs more room than the places have: "
            + (f"its lines would be {share:.0%} as high as those that these were" if share else "they were")
            + f" chosen for ({shortened(plan.parameters.text)!r}), and {LEAST:.0%} is the least.",
            "Use a shorter text, or mark the asset anew with this text among its copies.",
        )
    return Boxes(places.center, places.axes, np.column_stack([sizes, places.size[:, 2]])), used


def _placement(plan: Plan, boxes: Boxes) -> Placement:
    """The places of a plan, between which nothing is left to choose."""
    visible = np.zeros((len(boxes), VIEWS), dtype=bool)
    for number, mark in enumerate(plan.marks):
        visible[number, list(mark.views)] = True
    return Placement(
        boxes=boxes,
        loss=np.array([mark.loss for mark in plan.marks]),
        roughness=np.array([mark.roughness for mark in plan.marks]),
        visible=visible,
        likelihood=np.zeros((len(boxes), 0), dtype=np.float32),
        cost=np.zeros(len(boxes)),
        last_resort=np.zeros(len(boxes), dtype=bool),
        weight=np.zeros(0),
    )
