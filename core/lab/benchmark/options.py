"""Options of a benchmark run."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError

NO_ATTACK = "none"
REMOVAL = "removal"
PAPER_ATTACKS = ("crop", "removal", "remesh", "decimate", "subdivide")
INVISIBLE = "invisible"  # the one method that places no marks: it has no count
METHODS = (
    *("meshmark", "meshmark-default"),
    *("li", "paper", "paper-no-curve-matching", "paper-no-optimization", "paper-no-filtering"),
    INVISIBLE,
)
# Our own method without one term of its objective each: `--methods objective`.
OBJECTIVE_METHODS = (
    *("meshmark", "meshmark-no-seeing", "meshmark-no-legibility", "meshmark-no-backup", "meshmark-no-crops"),
    *("meshmark-no-obstructed", "meshmark-no-saliency", "meshmark-no-roll", "meshmark-no-flatness"),
    *(
        "meshmark-no-crowd",
        "meshmark-no-joint",
        "meshmark-no-exposed",
        "meshmark-no-texture",
        "meshmark-no-cost-of-marks",
    ),
)


@dataclass(frozen=True)
class AttackRequest:
    """An attack by name; ``strength`` None is the attack's own default."""

    name: str
    strength: float | None = None

    @staticmethod
    def parse(text: str) -> "AttackRequest":
        """``name`` or ``name:strength``; raises ``invalid_parameters``."""
        name, _, strength = text.partition(":")
        try:
            return AttackRequest(name, float(strength) if strength else None)
        except ValueError:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                f"The strength in {text!r} is not a number.",
                "Write an attack as `name` or `name:strength`, for instance `remesh:0.3`.",
            ) from None


def attack_requests(names: Sequence[str]) -> tuple[AttackRequest, ...]:
    """The attacks that ``names`` ask for; "all" stands for the paper's, "thief" for those of the ladder.

    Raises:
        MeshmarkError: ``invalid_parameters`` for a strength that is no number.
    """
    from core.lab.attacks.ladder import LADDER

    groups = {"all": PAPER_ATTACKS, "thief": tuple(LADDER)}
    return tuple(AttackRequest.parse(one) for name in names for one in groups.get(name, (name,)))


@dataclass(frozen=True)
class BenchmarkOptions:
    """One benchmark run. Lengths are in the size-30 frame.

    Attributes:
        folder: the dataset.
        out: folder of rows, tables and plots; a run there with the same options continues an interrupted one.
        dataset: its layout, a key of ``core.lab.benchmark.datasets.LAYOUTS``.
        split: for datasets that are split.
        samples: number of assets to draw, stratified by class; None takes all.
        methods: keys of ``core.lab.baselines.STRATEGIES``, or ``invisible``.
        counts: requested numbers of watermarks.
        attacks: besides the unattacked asset, which is always measured.
        attack_counts: the counts at which attacks are run; empty for the middle one of ``counts``.
        text: of the watermarks.
        size: width of the text, the same for all methods; None: 5.5, and for our own product as wide as fits
            each place.
        relief: height of the letters where the method leaves it open; None: 0.02 text widths.
        color: ``"#rrggbb"``: of the letters of our own pipeline, and of all letters in a second OCR.
        views: number of the paper's 24 views in the pictures.
        resolution: of the pictures, in pixels.
        level: ``full``, or ``geometry`` without the metrics of pictures.
        seed: with an asset's content it decides all draws on that asset.
        processes: number of assets processed at once.
        row_seconds: time limit of a single marking, attack or measurement.
        retry_failed: run failed rows again.
        report_only: write tables and plots from the rows that are there.
    """

    folder: Path
    out: Path
    dataset: str = "folder"
    split: str = "train"
    samples: int | None = None
    methods: tuple[str, ...] = METHODS
    counts: tuple[int, ...] = (4, 16, 32)
    attacks: tuple[AttackRequest, ...] = ()
    attack_counts: tuple[int, ...] = ()
    text: str = "watermark"
    size: float | None = None
    relief: float | None = None
    color: str | None = None
    views: int = 24
    resolution: int = 1024
    level: Evaluate = Evaluate.FULL
    seed: int = 0
    processes: int = 1
    row_seconds: float = 900.0
    retry_failed: bool = False
    report_only: bool = False

    def __post_init__(self) -> None:
        problems = [
            (not self.methods, "no method is named"),
            (not self.counts or min(self.counts) < 1, "counts must be at least 1"),
            (not set(self.attack_counts) <= set(self.counts), "attack counts must be among the counts"),
            (not 1 <= self.views <= 24, "views must be between 1 and 24"),
            (self.resolution < 64, "the resolution must be at least 64 pixels"),
            (self.processes < 1, "at least one process is needed"),
            (self.samples is not None and self.samples < 1, "at least one sample is needed"),
            (self.row_seconds <= 0, "the time limit must be positive"),
        ]
        found = [text for wrong, text in problems if wrong]
        if found:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                f"The benchmark cannot run like this: {'; '.join(found)}.",
                "Correct these options; `meshmark benchmark --help` lists them.",
            )

    @property
    def attacked_counts(self) -> tuple[int, ...]:
        """The counts at which attacks are run."""
        return self.attack_counts or (sorted(self.counts)[len(self.counts) // 2],)

    def settings(self) -> dict[str, Any]:
        """Options that decide a row's values beside the asset, the method, the count, the attack and the seed."""
        names = ("text", "size", "relief", "color", "views", "resolution")
        return {name: getattr(self, name) for name in names} | {"level": self.level.value}
