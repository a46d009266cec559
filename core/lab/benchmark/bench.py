"""One asset on the bench: watermarked, attacked and measured, with everything shared made once."""

import hashlib
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bool, Float
from core.budgets import DEFAULT_BUDGETS
from core.choices import Evaluate
from core.errors import MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import MODEL_SIZE, Surface
from core.gltf.scene import Scene, flatten, scene_of
from core.lab.attacks.attack import ATTACKS
from core.lab.attacks.ladder import LADDER
from core.lab.attacks.letters import looks
from core.lab.attacks.redrawn import redrawn
from core.lab.attacks.target import Attacked, Target, letter_faces, whole
from core.lab.baselines import STRATEGIES
from core.lab.baselines.invisible import LENGTH, bit_accuracy, embed, extract
from core.lab.baselines.strategy import Marked, Prepared, prepare, text_width
from core.lab.benchmark.datasets import Asset
from core.lab.benchmark.options import INVISIBLE, NO_ATTACK, AttackRequest, BenchmarkOptions
from core.lab.benchmark.rows import Row
from core.lab.benchmark.theft import NOISE, STRIPPED, recovered
from core.lab.plain import Mesh, plain, plain_glb
from core.metrics.measure import Pair, Subject, measure
from core.metrics.ocr import ocr
from core.metrics.recognition import Reader
from core.parameters import NO_COLOR, Parameters
from core.rendering.pictures import DIRECTIONS, UPS, Views, pictures
from core.rendering.relief import relief_pictures
from core.rendering.renderer import Frame, Renderer

Pictures = NDArray[np.uint8]

PAINT = "#d02020"  # of letters with a colour of their own, in pictures of clay

# The parts of a prepared asset that a method needs. They are made once for all methods, and each method's run time
# counts all that it needs; our own product, whole or without a term, reads the file itself and is not listed.
_BOOLEAN = ("reading", "solid")
_FITTED = (*_BOOLEAN, "candidates", "fine-tuning")
NEEDS: dict[str, tuple[str, ...]] = {
    "li": _BOOLEAN,
    "paper": (*_FITTED, "saliency"),
    "paper-no-curve-matching": (*_FITTED, "saliency"),
    "paper-no-optimization": (*_BOOLEAN, "candidates", "saliency"),
    "paper-no-filtering": _FITTED,
    INVISIBLE: ("reading",),
}


@dataclass(frozen=True, eq=False)
class Trial:
    """A watermarked asset with the values that its rows share.

    Attributes:
        marked: the result, in the original's size-30 frame.
        seconds: by step, and ``run`` from the file's bytes to the result.
        bits: of an invisible watermark; None for visible ones.
    """

    marked: Marked
    seconds: dict[str, float]
    bits: NDArray[np.bool_] | None

    @cached_property
    def index(self) -> SpatialIndex:
        """Over the result."""
        return SpatialIndex(self.marked.mesh.positions, self.marked.mesh.faces)

    def letters(self, attacked: Attacked, original: SpatialIndex) -> NDArray[np.bool_]:
        """(F,) the faces of ``attacked`` that belong to letters: colours stay on their region of the surface in every
        attack, so a face has the colour of the nearest point before it."""
        before = moved_points(attacked.mesh.positions, np.asarray(np.linalg.inv(attacked.transform), dtype=np.float64))
        _, nearest, _ = self.index.closest(before[attacked.mesh.faces].mean(axis=1))
        return letter_faces(self.marked.mesh, original)[nearest]


def open_bench(asset: Asset, seed: int, options: BenchmarkOptions) -> "AssetBench":
    """The bench of one file.

    Raises:
        MeshmarkError: where the file cannot be read.
    """
    return AssetBench(asset.path.read_bytes(), seed, options)


class AssetBench:
    """See :class:`core.lab.benchmark.worker.Bench`.

    Args:
        data: the file.
        seed: of every draw on this asset; methods that draw the same kind of thing draw the same.
        options: of the run.

    Attributes:
        mesh: the asset, without materials.
    """

    def __init__(self, data: bytes, seed: int, options: BenchmarkOptions) -> None:
        self._seed, self._options = seed, options
        self._parts: dict[str, float] = {}
        with _timed(self._parts, "reading"):
            self._prepared: Prepared = prepare(data, options.text, seed)
        self.mesh = plain(self._prepared.surface)
        self._parameters = Parameters(
            text=options.text,
            size=options.size,
            size_exact=options.size is not None,
            relief=options.relief,
            color=options.color or NO_COLOR,
            seed=seed,
        )

    @cached_property
    def delivered(self) -> Scene:
        """The asset in its own materials."""
        return flatten(document_of(admit(self._prepared.data, DEFAULT_BUDGETS), DEFAULT_BUDGETS))

    def facts(self) -> Row:
        """Bytes, vertices (those of one place and node counted once) and faces of the asset, and whether it has
        textures."""
        mesh, prepared = self.mesh, self._prepared
        sizes = {"bytes": len(prepared.data), "vertices": len(mesh.positions), "faces": len(mesh.faces)}
        return sizes | {"textured": prepared.textured}

    def mark(self, method: str, count: int) -> Trial:
        """The asset watermarked by ``method``.

        Raises:
            MeshmarkError: where the method refuses the asset.
        """
        seconds = {part: self._part(part) for part in NEEDS.get(method, ())}
        bits = None
        with _timed(seconds, "marking"):
            if method == INVISIBLE:
                bits = np.random.default_rng(self._seed).random(LENGTH) < 0.5
                marked = Marked(embed(self.mesh, bits), Boxes.empty(), np.empty(0))
            else:
                parameters = self._parameters.model_copy(update={"count": count}).resolved()
                marked = STRATEGIES[method](self._prepared, parameters, np.random.default_rng(self._seed))
        return Trial(marked, seconds | {"run": round(sum(seconds.values()), 4)}, bits)

    def measure(self, trial: Trial, attack: AttackRequest) -> Row:
        """All metrics of ``trial`` after ``attack``, against the original moved along with it.

        A mark that the attack cut away is not measured; where none is left, or none was ever visible, no view has a
        mark that faces it, and Ray and coverage are 0 by their definition.

        Raises:
            MeshmarkError: where the attack cannot be made.
        """
        options, marked = self._options, trial.marked
        seconds = dict(trial.seconds) if attack.name == NO_ATTACK else {}
        as_attacked = self._attacked(marked, attack, seconds)
        attacked = self._framed(as_attacked)
        original, frame = self._original(attacked.transform)
        scale = float(np.cbrt(np.linalg.det(attacked.transform[:3, :3])))
        boxes = moved_boxes(marked.boxes[attacked.kept], attacked.transform)
        surface = attacked.mesh.surface()
        # Of an invisible watermark only the bits are measured after an attack.
        only_read = trial.bits is not None and attack.name != NO_ATTACK
        left = self._painted(trial, attacked) if attack.name in LADDER else None
        clay = self.clay(attacked.mesh, left, None if left is None else PAINT)
        seen = None if only_read else self._seen(clay, seconds, "pictures", frame)
        pair = Pair(
            original=original,
            watermarked=Subject(surface, SpatialIndex(surface.positions, surface.faces), _alike(seen), self._seed),
            boxes=boxes,
            relief=marked.relief[attacked.kept] * scale,
            text=options.text,
            seed=self._seed,
        )
        found = measure(pair, Evaluate.GEOMETRY if only_read else options.level)
        values: dict[str, float | None] = dict(found.values)
        missing = {name: str(reason.code) for name, reason in found.missing.items()}
        if len(boxes) == 0:
            values |= {"ray": 0.0, "ray_box": 0.0, "coverage": 0.0, "crop_survival": 0.0}
            missing = {name: code for name, code in missing.items() if values[name] is None}
        if options.color is not None and options.level is Evaluate.FULL and trial.bits is None:
            letters = trial.letters(attacked, self._prepared.index)
            painted = self.clay(attacked.mesh, letters, options.color)
            values |= self._read(painted, "ocr_color", "coloured", seconds, frame)
        if attack.name in LADDER and len(marked.boxes):
            values |= self._stolen(marked, attacked.mesh, clay, values["ocr"], seconds)
        as_drawn = self._as_drawn(trial, attack, attacked)
        if as_drawn is not None and options.level is Evaluate.FULL:
            values |= self._read(as_drawn, "ocr_delivered", "delivered", seconds, None)
        row: Row = {
            "marks": len(marked.boxes) if trial.bits is None else None,
            "survived": float(attacked.kept.mean()) if len(attacked.kept) else None,
            "metrics": {name: _finite(value) for name, value in values.items()},
            "missing": missing,
            "semantics": found.semantics or None,
            "seconds": seconds | {f"measuring {name}": spent for name, spent in found.seconds.items()},
        }
        if trial.bits is not None:
            try:
                row["bit_accuracy"] = bit_accuracy(trial.bits, extract(as_attacked.mesh, len(trial.bits)))
            except MeshmarkError as error:  # the attack left too few vertices to read anything
                row["missing"]["bit_accuracy"] = error.code.value
        return row

    def _part(self, name: str) -> float:
        """Seconds that a shared part took, which is made now unless it exists."""
        make: dict[str, Callable[[], Any]] = {
            "solid": lambda: self._prepared.solid,
            "candidates": lambda: self._prepared.initial(text_width(self._parameters)),
            "fine-tuning": lambda: self._prepared.fitted(text_width(self._parameters)),
            "saliency": lambda: self._prepared.saliency,
        }
        if name not in self._parts:
            with _timed(self._parts, name):
                make[name]()
        return self._parts[name]

    def _attacked(self, marked: Marked, attack: AttackRequest, seconds: dict[str, float]) -> Attacked:
        # Seeded by asset and attack: every method is cut by the same plane and turned about the same axis.
        stream = int.from_bytes(hashlib.sha256(attack.name.encode()).digest()[:4])
        rng = np.random.default_rng([self._seed, stream])
        file = marked.delivered
        if file is None and attack.name in LADDER:
            file = self.clay(marked.mesh)
        target = Target(self._prepared.index, marked.boxes, rng, file)
        if attack.name == NO_ATTACK:
            return whole(marked.mesh, target)
        with _timed(seconds, "attack"):
            return (ATTACKS | LADDER)[attack.name](marked.mesh, target, attack.strength)

    def _framed(self, attacked: Attacked) -> Attacked:
        """An attacked asset in the size-30 frame of the original moved along with it: what is measured, and seen by
        cameras, is framed first, as any viewer does."""
        if (attacked.transform == np.eye(4)).all():
            return attacked
        surface = self._prepared.surface
        moved = moved_points(surface.positions[np.unique(surface.faces)], attacked.transform)
        low, high = moved.min(axis=0), moved.max(axis=0)
        frame = np.diag([*np.full(3, MODEL_SIZE / (high - low).max()), 1.0])
        frame[:3, 3] = -frame[0, 0] * (low + high) / 2
        mesh = Mesh(moved_points(attacked.mesh.positions, frame), attacked.mesh.faces)
        return replace(attacked, mesh=mesh, transform=frame @ attacked.transform)

    def _original(self, transform: Float) -> tuple[Subject, Frame | None]:
        """The original moved along with an attack, and the frame in which both are shown."""
        if (transform == np.eye(4)).all():
            return self._unmoved
        surface = replace(self._prepared.surface, positions=moved_points(self._prepared.surface.positions, transform))
        mesh = Mesh(moved_points(self.mesh.positions, transform), self.mesh.faces)
        return self._shown(surface, SpatialIndex(surface.positions, surface.faces), mesh)

    @cached_property
    def _unmoved(self) -> tuple[Subject, Frame | None]:
        return self._shown(self._prepared.surface, self._prepared.index, self.mesh)

    def _shown(self, surface: Surface, index: SpatialIndex, mesh: Mesh) -> tuple[Subject, Frame | None]:
        seen = self._seen(self.clay(mesh), {}, "original", None)
        renderer = self._renderer if isinstance(seen, np.ndarray) and len(seen) else None
        frame = renderer.frame if isinstance(renderer, Renderer) else None
        return Subject(surface, index, _alike(seen), self._seed), frame

    def clay(self, mesh: Mesh, letters: Bool | None = None, color: str | None = None) -> Scene:
        """A mesh in grey clay that shows its back faces where the asset's own materials do: through the holes of an
        attack a viewer sees what these let it see."""
        return scene_of(plain_glb(mesh, letters, color, self._prepared.double_sided))

    def _as_drawn(self, trial: Trial, attack: AttackRequest, attacked: Attacked) -> Scene | None:
        """The asset in its own materials, as a user gets it or as a thief of the ladder leaves it; None where there is
        only the mesh."""
        file = trial.marked.delivered
        if file is None or attack.name == NO_ATTACK:
            return file
        if attack.name not in LADDER or attacked.source is None:
            return None
        return redrawn(file, attacked.mesh, attacked.source)

    def _painted(self, trial: Trial, attacked: Attacked) -> NDArray[np.bool_] | None:
        """(F,) the faces of an ``attacked`` asset that still have the colour of letters; None where letters never had
        one of their own."""
        scene, source = trial.marked.delivered, attacked.source
        if scene is None or source is None:
            return None
        letter = letter_faces(trial.marked.mesh, self._prepared.index)
        look = looks(scene)
        # The ground has faces off the original, too, in the trenches: what no face on it has is the letters' own.
        own = letter & ~np.isin(look, look[~letter])
        return np.where(source >= 0, own[source], False) if own.any() else None

    def _stolen(
        self, marked: Marked, mesh: Mesh, scene: Scene, readable: float | None, seconds: dict[str, float]
    ) -> dict[str, float | None]:
        """Metrics of a theft: see :mod:`core.lab.benchmark.theft`."""
        original = Mesh(self._prepared.surface.positions, self._prepared.surface.faces)
        regained = recovered(original, marked.mesh, mesh, marked.boxes)
        if readable is None:
            return {"recovered": regained}
        relief = self._read_relief(scene, seconds)
        noise, noise_relief = self._noise
        lost = readable < noise + NOISE and relief < noise_relief + NOISE
        return {
            "recovered": regained,
            "ocr_relief": relief,
            "stripped": float(regained >= STRIPPED and lost),
        }

    @cached_property
    def _noise(self) -> tuple[float, float]:
        """OCR where there is no watermark, in ordinary and in relief pictures."""
        read = ocr(self._unmoved[0].views.compared, (self._options.text,), self._reader)
        return read.ratio, self._read_relief(self.clay(self.mesh), {})

    def _read_relief(self, scene: Scene, seconds: dict[str, float]) -> float:
        renderer = self._renderer
        assert isinstance(renderer, Renderer)
        views = self._views
        frame = self._unmoved[1]
        with _timed(seconds, "relief pictures"):
            seen = relief_pictures(scene, renderer, DIRECTIONS[views], UPS[views], frame)
        with _timed(seconds, "relief OCR"):
            return ocr(seen, (self._options.text,), self._reader).ratio

    @property
    def _views(self) -> NDArray[np.int64]:
        return np.arange(self._options.views) * len(DIRECTIONS) // self._options.views

    def _read(
        self, scene: Scene, metric: str, kind: str, seconds: dict[str, float], frame: Frame | None
    ) -> dict[str, float]:
        """OCR of ``scene`` in its own materials: the values of ``metric``, none where no pictures can be had."""
        seen = self._seen(scene, seconds, f"{kind} pictures", frame)
        if isinstance(seen, MeshmarkError) or len(seen) == 0:
            return {}
        with _timed(seconds, f"{kind} OCR"):
            read = ocr(seen, (self._options.text,), self._reader)
        return {metric: read.ratio, f"{metric}_ge_0.8": read.ge_08, f"{metric}_exact": read.exact}

    def _seen(
        self, scene: Scene, seconds: dict[str, float], step: str, frame: Frame | None
    ) -> Pictures | MeshmarkError:
        """Pictures of ``scene``, evenly chosen among the paper's 24 views; or the error. Timed as ``step``."""
        if self._options.level is not Evaluate.FULL:
            return np.empty((0, 1, 1, 3), dtype=np.uint8)
        renderer = self._renderer
        if isinstance(renderer, MeshmarkError):
            return renderer
        views = self._views
        try:
            with _timed(seconds, step):
                return pictures(scene, renderer, DIRECTIONS[views], UPS[views], frame)
        except MeshmarkError as error:
            return error

    @cached_property
    def _renderer(self) -> Renderer | MeshmarkError:
        # Lives as long as the process, which works on this asset only.
        try:
            return Renderer(self._options.resolution)
        except MeshmarkError as error:
            return error

    @cached_property
    def _reader(self) -> Reader:
        return Reader()


def moved_points(points: Float, transform: Float) -> Float:
    """(N, 3) points under a (4, 4) similarity."""
    return np.asarray(points @ transform[:3, :3].T + transform[:3, 3])


def moved_boxes(boxes: Boxes, transform: Float) -> Boxes:
    """Boxes under a (4, 4) similarity without a mirror; no other map leaves their axes orthogonal."""
    scale = float(np.cbrt(np.linalg.det(transform[:3, :3])))
    axes = boxes.axes @ (transform[:3, :3] / scale).T
    return Boxes(moved_points(boxes.center, transform), axes, boxes.size * scale)


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


@contextmanager
def _timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    start = time.perf_counter()
    yield
    seconds[name] = round(time.perf_counter() - start, 4)


def _alike(seen: Pictures | MeshmarkError | None) -> Views | MeshmarkError | None:
    return Views(seen, seen) if isinstance(seen, np.ndarray) else seen
