"""A series of copies of one asset: it is read and placed once, and marked with one text after the other."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from core import marking
from core.budgets import DEFAULT_BUDGETS, Budgets
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters
from core.pipeline import Result, run_stages
from core.stages import Request

# Errors of a text: the others of the series may be set nevertheless.
OF_TEXT = (ErrorCode.EMPTY_TEXT, ErrorCode.INVALID_PARAMETERS, ErrorCode.MISSING_GLYPHS, ErrorCode.TEXT_TOO_LONG)


def watermark_series(
    data: bytes,
    parameters: Sequence[Parameters],
    *,
    font: bytes | None = None,
    logo: bytes | None = None,
    budgets: Budgets = DEFAULT_BUDGETS,
    preview: bool = True,
    progress: Callable[[int, str, float], None] = lambda _number, _stage, _share: None,
) -> Iterator[Result | MeshmarkError]:
    """Emboss a text into each copy of a mesh file, all at the same places, which have room for the longest.

    Args:
        data: the content of a file.
        parameters: of each copy; they differ in their text.
        font, logo, budgets, preview: as for :func:`core.pipeline.watermark`.
        progress: called with the number of the present copy, its stage and the share done of its run, 0 to 1.

    Yields:
        For each text the result, or why it could not be set.

    Raises:
        MeshmarkError: where the asset cannot be watermarked.
    """
    asset, plan = marking.read(data, budgets), None
    texts = tuple(each.text for each in parameters)
    for number, each in enumerate(parameters):
        request = Request(each.resolved(), font, logo, budgets, preview, plan=plan, copies=texts)
        try:
            result = run_stages(data, request, partial(progress, number), before=asset)
        except MeshmarkError as error:
            if plan is None and error.code not in OF_TEXT:
                raise
            yield error
        else:
            plan = plan or result.plan
            yield result
