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
from core.formats.admission import admit, document_of
from core.gltf.scene import Scene, flatten
from core.metrics.recognition import Reader
from core.notices import Notice, NoticeCode
from core.rendering.renderer import Renderer
from core.report import Engine
from core.reporting import file_facts
from core.verify.marks import PICTURE, FoundMark, find_marks
from core.verify.metadata import read_label
from core.verify.report import ReadMark, VerificationReport


@dataclass(frozen=True)
class Verification:
    """Result of :func:`verify`.

    Attributes:
        report: ``meshmark.verification/1``.
        pictures: a PNG of each of its marks, seen head-on.
    """

    report: dict[str, Any]
    pictures: tuple[bytes, ...]


def verify(data: bytes, texts: Sequence[str] = (), budgets: Budgets = DEFAULT_BUDGETS) -> Verification:
    """Marks and labels of a file of any accepted format, whoever made them.

    Args:
        data: the suspect file.
        texts: known texts that marks may say; without any, everything is told that can be read with confidence.
        budgets: the most that the file may declare before it is read.

    Raises:
        MeshmarkError: as the loaders; ``rendering_unavailable`` where nothing can be drawn, and so nothing be read.
    """
    start = time.perf_counter()
    admitted = admit(data, budgets)
    document = document_of(admitted, budgets)
    scene, label = flatten(document), read_label(document.json)
    read, reader = time.perf_counter(), Reader()
    with Renderer(PICTURE) as renderer:
        marks = find_marks(scene, texts, renderer, reader)
    report = VerificationReport(
        file=file_facts(data, admitted.format),
        engine=Engine(version=__version__, device=device().value),
        texts=list(texts),
        found=[text for text in texts if any(mark.known == text for mark in marks)] if texts else None,
        marks=[_mark(mark, scene) for mark in marks],
        label=label,
        warnings=[*document.warnings, *_unreadable(texts, reader)],
        timings={"reading": round(read - start, 4), "marks": round(time.perf_counter() - read, 4)},
    )
    return Verification(report.model_dump(mode="json"), tuple(_png(mark) for mark in marks))


def _mark(mark: FoundMark, scene: Scene) -> ReadMark:
    place, surface = mark.place, scene.surface
    return ReadMark(
        text=mark.text,
        known=mark.known,
        likeness=round(mark.likeness, 4),
        confidence=round(mark.confidence, 4),
        votes=mark.votes,
        pictures=list(mark.kinds),
        center=surface.to_world(place.center).tolist(),
        right=place.right.tolist(),
        normal=place.normal.tolist(),
        length=place.length / surface.scale,
    )


def _png(mark: FoundMark) -> bytes:
    file = io.BytesIO()
    Image.fromarray(mark.picture).save(file, "PNG")
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
