"""The stages behind the watermarked GLB: its report, its pictures, its metrics."""

import json
import logging
from contextlib import ExitStack
from hashlib import sha256
from typing import Any

from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.rendering.pictures import PICTURE_SIZE, Drawn, Views, views
from core.rendering.preview import contact_sheet
from core.rendering.renderer import Renderer
from core.rendering.turntable import turntable
from core.report import FontFacts, Report
from core.stages import Asset, Candidates, Ground, LightOutput, Output, Pictures, Run

log = logging.getLogger(__name__)

# Groups of metrics that a preview model shares with the model, whose marks it carries, or that cost much.
SHARED = ("placement", "label height", "curvature", "saliency", "semantics")


def report(asset: Asset, output: Output, light: LightOutput | None, run: Run) -> Report:
    """The report without its metrics, published at once, so that the job has one if a later stage fails."""
    from core.reporting import build_report

    result = build_report(asset, output, run.request.parameters, light)
    if run.request.plan is not None:
        result = result.model_copy(update={"plan": sha256(run.request.plan.to_json()).hexdigest()})
    run.publish("report", json.dumps(as_json(result, run), allow_nan=False).encode())
    return result


def explain(asset: Asset, candidates: Candidates | None, output: Output, run: Run) -> None:
    """Publish why marks stand where they stand, where somebody asked for it: figures and a model with layers."""
    if candidates is None or not run.request.parameters.explain:
        return
    from core.explain.explain import explanation
    from core.explain.layers import layers, model
    from core.explain.trace import Trace

    assert isinstance(run.request.watch, Trace)
    explained = explanation(asset, candidates, output, run.request.watch)
    run.publish("explanation", json.dumps(explained.facts, allow_nan=False).encode())
    run.publish("layers", model(explained, layers(explained)))


def as_json(report: Report, run: Run) -> dict[str, Any]:
    """The report with the fonts, notices, times and memory of the stages so far, as JSON has it."""
    fonts = [FontFacts(name=face.name, version=face.version, thickened=face.offset) for face in run.faces]
    account = {"fonts": fonts, "warnings": run.notices, "timings": run.timings, "memory": run.memory}
    return report.model_copy(update=account).model_dump(mode="json")


def render(asset: Asset, output: Output, light: LightOutput | None, run: Run, drawing: ExitStack) -> Pictures:
    """The preview and the turntable, published, and the pictures for the metrics, from one OpenGL context, which is
    open until the end of ``drawing``: what text is read in is drawn when it is asked for.

    A machine that cannot render still delivers the asset, and says so.
    """
    request = run.request
    measured = request.parameters.evaluate is Evaluate.FULL
    turning = request.parameters.turntable
    if not (measured or request.preview or turning):
        return Pictures()
    preview: bytes | None = None
    animation: bytes | None = None
    poster: bytes | None = None
    seen: tuple[Views, Views] | MeshmarkError | None = None
    seen_light: Views | None = None
    try:
        renderer = Renderer(PICTURE_SIZE)
        drawing.callback(_close, renderer)
        if measured:
            before = views(asset.scene, renderer)
            if light is not None and light.output is not output:
                seen_light = Views(before.compared[:0], Drawn(light.output.scene, renderer, renderer.frame))
            seen = before, views(output.scene, renderer, renderer.frame)
        else:
            renderer.load(output.scene)
        if request.preview:
            preview = contact_sheet(renderer)
            run.publish("preview", preview)
        if turning:
            animation, poster = turntable(renderer)
            run.publish("turntable", animation)
            run.publish("poster", poster)
    except MeshmarkError as error:
        seen = error
    except Exception as error:  # drivers raise errors of all kinds
        log.exception("the pictures of this asset could not be drawn")
        seen = MeshmarkError(
            ErrorCode.RENDERING_UNAVAILABLE,
            f"The pictures of this asset could not be drawn ({type(error).__name__}).",
            "The model is not affected. Report it to the operator; the log holds the details.",
        )
    if isinstance(seen, MeshmarkError):
        run.notices.append(seen.notice())
    return Pictures(preview, animation, poster, seen, seen_light)


def _close(renderer: Renderer) -> None:
    try:
        renderer.close()
    except Exception:  # all is drawn: a driver's error here must not take it back
        log.exception("the renderer could not be closed")


def evaluate(
    asset: Asset,
    ground: Ground | None,
    output: Output,
    light: LightOutput | None,
    seen: Pictures,
    result: Report,
    run: Run,
) -> Report:
    """The report ``result`` with its metrics, measured on the files as they were written, rounding included."""
    parameters = run.request.parameters
    if parameters.evaluate is Evaluate.NONE:
        return result
    assert ground is not None
    assert output.embossed is not None
    from core.analysis.analyse import eye_index
    from core.metrics.measure import Pair, Subject, measure
    from core.reporting import boxes_of, with_metrics, with_own_metrics

    before, after = seen.views if isinstance(seen.views, tuple) else (seen.views, seen.views)
    mapped = None if ground.facts is None else ground.facts.saliency
    original = Subject(asset.analysis.surface, ground.carrier.index, before, parameters.seed, mapped)

    def pair(of: Output, drawn: Views | MeshmarkError | None) -> Pair:
        written, index = eye_index(of.scene, asset.scene.surface, through=ground.opaque > 0)
        assert of.embossed is not None
        boxes, relief = boxes_of(of.embossed.marks)
        settings = ground.layouts.settings(boxes.size)
        marked = Subject(written, index, drawn)
        return Pair(original, marked, boxes, relief, parameters.text, parameters.seed, ground.layouts, settings)

    measured = measure(pair(output, after), parameters.evaluate, run.progress)
    run.notices += measured.warnings
    if light is not None and light.output is not output:
        own = measure(
            pair(light.output, after if seen.light is None else seen.light), parameters.evaluate, shared=SHARED
        )
        result = with_own_metrics(result, own)
    return with_metrics(result, measured)
