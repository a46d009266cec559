"""Runs an asset through the stages, in order, and reports the progress."""

import resource
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any

from core import exporting, lightening, marking, measuring
from core.budgets import DEFAULT_BUDGETS, Budgets
from core.formats.format import OutputFile
from core.parameters import Parameters
from core.plan import Plan
from core.preload import preload as preload
from core.stages import Asset, Candidates, Ground, LightOutput, Publish, Request, Run

Progress = Callable[[str, float], None]

# The stages by name, in order, and the share of each in the progress bar.
STAGES = {
    "reading": 0.05,
    "lettering": 0.02,
    "placing": 0.25,
    "embossing": 0.13,
    "writing": 0.03,
    "reporting": 0.02,
    "rendering": 0.2,
    "evaluating": 0.3,
}


@dataclass(frozen=True)
class Result:
    """The results of a run.

    Attributes:
        file: the watermarked model.
        report: ``meshmark.report/1``; ``service/docs/report.md`` has its fields.
        asset: as it was read, for copies of it with other texts.
        preview: a PNG contact sheet; None where none was asked for, or where none could be rendered (then the
            report's ``warnings`` say why).
        turntable, poster: animated WebP of the model as it turns, and its first frame; None as for ``preview``.
        preview_model: a light GLB beside ``file``; None where none was asked for, where it is ``file`` itself, or where
            no mark fits on it (then the report's ``warnings`` say so).
        export: the watermarked model in another format; None where none was asked for.
        plan: where its marks stand, for other texts; None where they stand by a plan, or where there are none.
    """

    file: OutputFile
    report: dict[str, Any]
    asset: Asset
    preview: bytes | None
    turntable: bytes | None = None
    poster: bytes | None = None
    preview_model: bytes | None = None
    export: OutputFile | None = None
    plan: Plan | None = None

    @property
    def model(self) -> bytes:
        """The bytes of ``file``."""
        return self.file.data


def watermark(
    data: bytes,
    parameters: Parameters,
    *,
    font: bytes | None = None,
    logo: bytes | None = None,
    budgets: Budgets = DEFAULT_BUDGETS,
    preview: bool = True,
    plan: Plan | None = None,
    copies: Sequence[str] = (),
    before: Asset | None = None,
    progress: Progress | None = None,
    publish: Publish | None = None,
) -> Result:
    """Embosses a watermark into a mesh file.

    Args:
        data: the content of a file; the format is recognised by it.
        parameters: text, style, number and the rest.
        font: a TrueType or OpenType file; None for the bundled one.
        logo: an SVG file, to be embossed alone or beside the text.
        budgets: the most that the asset may declare before it is read.
        preview: render a contact sheet.
        plan: of an earlier run for this file, whose places are taken; None to search for places.
        copies: other texts that the places should have room for.
        before, progress, publish: as for :func:`run_stages`.

    Returns:
        The GLB, the report and the preview. The same arguments on the same device give the same GLB bytes.

    Raises:
        MeshmarkError: where the asset cannot be watermarked; nothing was published then.
    """
    request = Request(parameters.resolved(), font, logo, budgets, preview, plan=plan, copies=tuple(copies))
    return run_stages(data, request, progress, publish, before)


def run_stages(
    data: bytes,
    request: Request,
    progress: Progress | None = None,
    publish: Publish | None = None,
    before: Asset | None = None,
) -> Result:
    """As :func:`watermark`.

    Args:
        data: the content of a file.
        request: the wishes.
        progress: called with the stage's name and the share done of the whole run, 0 to 1.
        publish: called with the name of each result ("model", "plan", "preview_model", "export", "report",
            "explanation", "layers", "preview", "turntable", "poster") and its bytes as soon as it exists, before the
            run ends. The report is the final one if the run breaks off afterwards: its metrics are still missing.
        before: the asset, where it was read before (:func:`core.marking.read`).
    """
    if request.parameters.explain:
        from core.explain.trace import Trace

        request = replace(request, watch=Trace())
    wish = request.parameters.preview_model
    run = Run(request, lambda _share: None, publish or (lambda _name, _bytes: None))

    @contextmanager
    def stage(name: str) -> Iterator[None]:
        before = sum(list(STAGES.values())[: list(STAGES).index(name)])

        def tell(share: float) -> None:
            if progress is not None:
                progress(name, before + STAGES[name] * min(share, 1.0))

        run.progress = tell
        tell(0.0)
        start = time.perf_counter()
        yield
        run.timings[name] = round(time.perf_counter() - start, 4)
        run.memory[name] = _peak_memory()

    with stage("reading"):
        asset = before or marking.read(data, request.budgets, request.parameters.format)
        run.notices += asset.notices
    candidates: Candidates | None = None
    ground: Ground | None = None
    plan: Plan | None = None
    light: LightOutput | None = None
    if request.parameters.metadata_only:
        with stage("writing"):
            output = exporting.with_export(asset, marking.write_label_alone(asset, run), run)
    else:
        from core.planned import follow, plan_of, roomy_layouts

        with stage("lettering"):
            layouts = marking.letter(run)
            text, roomy = (
                roomy_layouts(layouts, run)
                if request.copies and not request.plan
                else (request.parameters.text, layouts)
            )
        if request.plan is None:
            with stage("placing"):
                candidates = marking.place(asset, roomy, run)
        with stage("embossing"):
            follows = request.plan
            if candidates is not None:
                ground, embossed = candidates.ground, marking.emboss(asset, candidates, run)
                if text != request.parameters.text:
                    longest = request.parameters.model_copy(update={"text": text})
                    follows = plan = plan_of(asset, ground, embossed, longest)
            if follows is not None:
                ground, embossed = follow(asset, layouts, follows, run)
        with stage("writing"):
            assert ground is not None
            output = marking.write_model(asset, ground, embossed, run)
            if candidates is not None:
                plan = plan or plan_of(asset, ground, output.embossed or embossed, request.parameters)
                run.publish("plan", plan.to_json())
            light = lightening.lighten(asset, ground, output, run) if wish else None
            output = light.output if light and wish and wish.alone else exporting.with_export(asset, output, run)
    with stage("reporting"):
        report = measuring.report(asset, output, light, run)
        measuring.explain(asset, candidates, output, run)
    with ExitStack() as drawing:
        with stage("rendering"):
            seen = measuring.render(asset, output, light, run, drawing)
        with stage("evaluating"):
            report = measuring.evaluate(asset, ground, output, light, seen, report, run)
    told = measuring.as_json(report, run)
    beside = light.output.file.data if light and light.output is not output else None
    exported = output.exported.file if output.exported else None
    return Result(output.file, told, asset, seen.preview, seen.turntable, seen.poster, beside, exported, plan)


def _peak_memory() -> int:
    """Peak resident memory of this process in bytes; getrusage counts in KiB except on macOS."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
