"""The stage that makes the preview model: fewer triangles, smaller images, and then the marks of the model in it."""

import time
from dataclasses import replace

from core.errors import ErrorCode, MeshmarkError
from core.gltf.fewer_triangles import fewer_triangles
from core.gltf.scene import flatten
from core.gltf.shown import only_shown
from core.gltf.smaller_textures import smaller_textures
from core.marking import drawn_alone, embossed_again, label_heights_of
from core.notices import Notice, NoticeCode
from core.preview_model import PreviewModel
from core.stages import Asset, Embossed, Ground, LightOutput, Output, Run

LISTED = 5  # things that a warning names
SMALLER = "Ask for fewer `triangles` in `preview_model`."


def lighten(asset: Asset, ground: Ground, output: Output, run: Run) -> LightOutput | None:
    """The preview model that was asked for, published; None where there is none, and a notice says why.

    Nothing of the asset goes into it but what its default scene shows. That is decimated first, and the boxes, letters
    and colours of the model's marks are embossed in what is left, so that letters have all their detail.

    Args:
        asset: that was marked.
        ground, output: of the model.
        run: under way.

    Raises:
        MeshmarkError: ``no_placement`` where it was to be made ``alone`` and none of the marks fits on it;
            ``device_unavailable``.
    """
    wish, embossed = run.request.parameters.preview_model, output.embossed
    if wish is None:
        return None
    assert embossed is not None
    try:
        light = _lightened(asset, ground, embossed, wish, run)
    except MeshmarkError as error:
        if wish.alone or error.code is ErrorCode.DEVICE_UNAVAILABLE:
            raise
        run.notices.append(
            Notice(NoticeCode.NO_PREVIEW_MODEL, f"There is no preview model. {error.message}", error.remedy)
        )
        return None
    run.publish("model" if wish.alone else "preview_model", light.output.file.data)
    return light


def _lightened(asset: Asset, ground: Ground, embossed: Embossed, wish: PreviewModel, run: Run) -> LightOutput:
    start = time.perf_counter()
    shown, left_out = only_shown(asset.scene.document)
    scene = flatten(shown)
    before = after = len(scene.surface.faces)
    if before > wish.triangles:
        shown, after = fewer_triangles(scene, wish.triangles)
    del scene
    shown, sizes, lost = smaller_textures(shown, wish.texture)
    notices = _notices(before, after, wish, left_out + [f"textures[{number}]" for number in lost])

    from core.analysis.analyse import analyse

    scene = flatten(shown)
    scene = replace(scene, surface=scene.surface.in_frame_of(asset.analysis.surface))
    light = Asset(asset.data, asset.format, scene, analyse(scene))
    ground, parameters = _ground(light, ground), run.request.parameters
    done = embossed_again(light, ground, replace(embossed, refusals={}), parameters)
    if not done.marks:
        raise MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            f"None of the {len(embossed.marks)} watermarks fits on the {after:,} triangles of a preview model.",
            "Allow it more `triangles`, or ask for smaller marks.",
        )
    done, _, output = drawn_alone(light, ground, done, parameters)
    if parameters.rule is not None:
        output = replace(output, heights=label_heights_of(done, ground))
    run.notices += notices
    return LightOutput(output, before, after, sizes, done.refusals, round(time.perf_counter() - start, 4))


def _ground(light: Asset, ground: Ground) -> Ground:
    """The ground of the marks on the light surface; keep-out regions have had their say when places were chosen."""
    from core.analysis.facts import Carrier

    analysis, opaque = light.analysis, ground.opaque > 0
    carrier = Carrier(
        analysis.surface,
        analysis.index if opaque else analysis.glazed,
        analysis.opaque if opaque else analysis.cuttable,
        analysis.component,
    )
    return replace(ground, carrier=carrier)


def _notices(before: int, after: int, wish: PreviewModel, left_out: list[str]) -> list[Notice]:
    notices = []
    if before <= wish.triangles:
        notices.append(
            Notice(
                NoticeCode.PREVIEW_MODEL_HEAVY,
                f"The preview model has all {before:,} triangles of the asset: {wish.triangles:,} were allowed.",
                SMALLER,
            )
        )
    elif after > wish.triangles:
        notices.append(
            Notice(
                NoticeCode.PREVIEW_MODEL_HEAVY,
                f"The preview model keeps {after:,} of {before:,} triangles, not the {wish.triangles:,} that were "
                "asked for: with fewer its shape would be lost, or its texture would tear at seams.",
                "Use it as it is, or send a model with fewer seams and parts.",
            )
        )
    if left_out:
        more = len(left_out) - LISTED
        named = ", ".join(left_out[:LISTED]) + (f" and {more:,} more" if more > 0 else "")
        notices.append(
            Notice(
                NoticeCode.PREVIEW_MODEL_LACKS,
                f"The preview model lacks {named}: points, lines and meshes that cannot be marked, and images that "
                "cannot be made smaller.",
                "Embed images as PNG, JPEG, WebP or KTX2; send other meshes as triangles.",
            )
        )
    return notices
