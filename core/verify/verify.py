"""Verification of a suspect file: the marks that can be read on it, and what its metadata say."""

import io
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from PIL import Image

from core import __version__
from core.budgets import DEFAULT_BUDGETS, Budgets
from core.device import device
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.gltf.scene import flatten
from core.metrics.recognition import Reader
from core.notices import Notice, NoticeCode
from core.rendering.renderer import Renderer
from core.report import Engine
from core.reporting import file_facts
from core.verify.header import picture_format
from core.verify.look import Picture
from core.verify.marks import PICTURE, FoundMark, find_marks
from core.verify.metadata import read_label
from core.verify.original import Against, Reference, align, compare, read_reference
from core.verify.picture import FoundText, decode, read_picture
from core.verify.report import Comparison, FileLabel, ReadMark, VerificationReport
from core.verify.seal import NO_SEAL, Seal, judge


@dataclass(frozen=True)
class Verification:
    """Result of :func:`verify`.

    Attributes:
        report: ``meshmark.verification/1``.
        pictures: a PNG of each of its marks, seen head-on.
        heights: a PNG of the relief over the original of each mark that was compared with it; none without one.
    """

    report: dict[str, Any]
    pictures: tuple[bytes, ...]
    heights: tuple[bytes, ...] = ()


def verify(
    data: bytes,
    texts: Sequence[str] = (),
    budgets: Budgets = DEFAULT_BUDGETS,
    against: Against | None = None,
    seal: Seal = NO_SEAL,
) -> Verification:
    """Marks and labels of a file of any accepted format, or marks in a picture of one (PNG, JPEG, WebP), whoever made
    them.

    Args:
        data: the suspect file.
        texts: known texts that marks may say; without any, those of the job's report, or everything is told that can
            be read with confidence.
        budgets: the most that the file, and an original, may declare before it is read.
        against: the original, and the report of a job, that a model is compared with.
        seal: a sidecar of the file's Content Credentials, and the certificates that are trusted.

    Raises:
        MeshmarkError: as the loaders and :func:`core.verify.seal.judge`; ``rendering_unavailable`` where nothing can
            be drawn, and so nothing be read; ``different_model`` where the original is that of another;
            ``invalid_parameters`` for a job's report that is none, and for an original of a picture.
    """
    start, kind = time.perf_counter(), picture_format(data)
    reader = Reader() if kind else Reader(threads=1)  # of a model, many pictures are read at a time
    if kind and against:
        raise _no_shape()
    credentials = judge(data, kind, seal)
    reference = read_reference(against, budgets) if against else None
    texts = texts or (reference.texts if reference else ())
    found = _in_picture(data, kind, texts, reader) if kind else _on_model(data, texts, reader, budgets, reference)
    known = {mark.known for mark in found.marks}
    report = VerificationReport(
        file=file_facts(data, found.format),
        engine=Engine(version=__version__, device=device().value),
        texts=list(texts),
        found=[text for text in texts if text in known] if texts else None,
        marks=found.marks,
        label=found.label,
        credentials=credentials,
        original=found.original,
        warnings=[*found.losses, *_unreadable(texts, reader)],
        timings={"all": round(time.perf_counter() - start, 4)},
    )
    return Verification(
        report.model_dump(mode="json"), tuple(map(_png, found.pictures)), tuple(map(_png, found.heights))
    )


@dataclass(frozen=True)
class _Found:
    """The format of a file, its marks with a picture of each, its label, losses in reading it, and the comparison with
    an original with pictures of the relief."""

    format: str
    marks: list[ReadMark]
    pictures: list[Picture]
    label: FileLabel | None = None
    losses: tuple[Notice, ...] = ()
    original: Comparison | None = None
    heights: Sequence[Picture] = ()


def _on_model(
    data: bytes, texts: Sequence[str], reader: Reader, budgets: Budgets, reference: Reference | None
) -> _Found:
    admitted = admit(data, budgets)
    document = document_of(admitted, budgets)
    scene, losses = flatten(document), list(document.warnings)
    try:
        label = read_label(document.json)
    except MeshmarkError as error:  # broken metadata must not keep the marks from being looked for
        label = None
        losses.append(error.notice())
    surface = scene.surface
    aligned = align(surface, reference) if reference else None  # before much time is spent: it may be another model
    with Renderer(PICTURE) as renderer:
        found = find_marks(scene, texts, renderer, reader)
    original, heights = compare(surface, data, aligned, reference, found) if reference and aligned else (None, [])
    marks = [
        ReadMark(
            **_said(mark),
            votes=mark.votes,
            pictures=list(mark.kinds),
            center=surface.to_world(mark.spot.center).tolist(),
            right=mark.spot.right.tolist(),
            normal=mark.spot.normal.tolist(),
            length=mark.spot.length / surface.scale,
        )
        for mark in found
    ]
    pictures = [mark.picture for mark in found]
    return _Found(admitted.format.value, marks, pictures, label, tuple(losses), original, heights)


def _in_picture(data: bytes, kind: str, texts: Sequence[str], reader: Reader) -> _Found:
    found = read_picture(decode(data), texts, reader)
    marks = [
        ReadMark(
            **_said(one),
            votes=1,
            pictures=["ordinary"],
            pixel=(round(float(one.pixel[0]), 1), round(float(one.pixel[1]), 1)),
        )
        for one in found
    ]
    return _Found(kind, marks, [one.picture for one in found])


def _no_shape() -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.INVALID_PARAMETERS,
        "The suspect file is a picture: it has no shape that could be compared with an original's.",
        "Leave the original out, or verify the model itself.",
    )


def _said(found: FoundMark | FoundText) -> dict[str, Any]:
    return {
        "text": found.text,
        "known": found.known,
        "likeness": round(found.likeness, 4),
        "confidence": round(found.confidence, 4),
    }


def _png(picture: Picture) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "PNG")
    return file.getvalue()


def _unreadable(texts: Sequence[str], reader: Reader) -> list[Notice]:
    """The notice of each text whose letters the recogniser does not know."""
    return [
        Notice(
            NoticeCode.UNREADABLE_SCRIPT,
            f'The text recognition does not know all letters of "{text}"; it reads Latin, Greek without accents, '
            "Chinese and Japanese.",
            "Look at the pictures yourself.",
        )
        for text in texts
        if reader.unknown(text)
    ]
