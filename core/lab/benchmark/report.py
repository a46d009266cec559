"""``REPORT.md``: every table and plot of a benchmark, from its rows and nothing else."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from core.lab.benchmark import pairwise as duel
from core.lab.benchmark import tables
from core.lab.benchmark.markdown import table
from core.lab.benchmark.options import INVISIBLE, NO_ATTACK
from core.lab.benchmark.plots import write_plots
from core.lab.benchmark.results import write_text
from core.lab.benchmark.rows import Row
from core.lab.benchmark.run_time import run_times
from core.lab.benchmark.select import counts, methods, middle_count, ok

OURS, THEIRS = "meshmark", "paper"


def write_report(rows: Sequence[Row], out: Path) -> None:
    """Write ``REPORT.md`` and the plots it shows into ``out``; raises ``output_not_writable``."""
    pictures = {path.stem: path.name for path in write_plots(rows, out)}
    write_text(out / "REPORT.md", report(rows, pictures))


def report(rows: Sequence[Row], pictures: dict[str, str]) -> str:
    """The whole report.

    Args:
        rows: of one benchmark, failed ones included.
        pictures: file names of the plots by the figure's name.
    """
    count = middle_count(rows)
    asked = f"{count} watermarks asked for"
    sections = [
        ("Meshes", [tables.mesh_statistics(rows), "Vertices of one place and node are counted once."]),
        (
            f"Quality and utility, {asked}",
            [
                "On all assets that a method marked:",
                *_both(tables.quality(rows, count, only_common=False), tables.quality(rows, count, only_common=True)),
                "As the paper printed it, on its own datasets and renderer:",
                tables.published_quality(),
            ],
        ),
        (
            f"Clay and as delivered, {asked}",
            [
                "Clay: pictures of the plain geometry in grey, as in all tables but this one and as in the paper. As "
                "delivered: the file that a user gets, in its own materials, textures and vertex colours. `meshmark` "
                "is asked for letters in the surface's own colour (or in `--color`), `meshmark-default` for nothing "
                "but the text and the number of marks; the other methods make plain geometry only.",
                tables.delivered(rows, count),
                "Each cell is clay / as delivered:",
                tables.delivered_by_asset(rows, count),
            ],
        ),
        (
            f"Ablation, {asked}",
            [
                "On the assets that all of these methods marked.",
                tables.ablation(rows, count),
                "As the paper printed it (ObjaVerse):",
                tables.published_ablation(),
            ],
        ),
        (
            f"Terms of the objective, {asked}",
            [
                "Our own pipeline without one of them, on the assets that all of these methods marked.",
                tables.objective(rows, count),
            ],
        ),
        (
            "Attacks",
            [
                "On all assets that a method marked and the attack could be made on:",
                *_both(tables.attacks(rows, only_common=False), tables.attacks(rows, only_common=True)),
                "As the paper printed it (Manifold40):",
                tables.published_attacks(),
            ],
        ),
        (
            "Thieves",
            [
                "Attacks by somebody who has only the marked file. An asset counts as stripped where 90 % of the clean "
                "shape is regained near the marks and the text is read neither in pictures of clay, letters with a "
                "colour of their own in red, nor in relief pictures.",
                tables.removal_resistance(rows),
            ],
        ),
        (
            "Beside an invisible watermark",
            [
                "Nothing can be seen of it, so its Ray is 0 by definition; its OCR is what the reader makes of the "
                "bare asset. The paper compares with Wang et al. 2020, this benchmark with Cho, Prost and Jung 2007.",
                tables.invisible(rows, count),
            ]
            if INVISIBLE in methods(rows)
            else ["The invisible method was not run."],
        ),
        (
            "Trade-off over the number of watermarks",
            [tables.trade_off(rows), *_pictures(pictures, "trade-off", "visibility", "prominence")],
        ),
        (
            f"Run time, {asked}",
            [
                "Seconds from the file's bytes to the watermarked mesh, shared steps counted for every method that "
                'needs them. The paper\'s were measured on 12 cores with two GPUs; it says "linear". A time beyond the '
                "span of the vertices is extrapolated, and processes that run side by side slow each other down.",
                run_times(rows, count),
                *_pictures(pictures, "run-time"),
            ],
        ),
        (
            f"{OURS} against {THEIRS}, asset by asset, {asked}",
            [
                duel.score(rows, count, OURS, THEIRS),
                f"Each cell is {OURS} / {THEIRS}, bold where {OURS} is worse.",
                duel.per_asset(rows, count, OURS, THEIRS),
            ],
        ),
        (f"Where {OURS} does not win", [_list(duel.losses(rows, count, OURS)) or "Nowhere in these tables."]),
        ("Time by step", [tables.stages(rows)]),
    ]
    parts = ["# Meshmark benchmark", *_overview(rows)]
    for number, (title, body) in enumerate(sections, start=2):
        parts += [f"## {number}. {title}", *body]
    return "\n\n".join(parts) + "\n"


def _both(everything: str, common: str) -> list[str]:
    """A table on all assets and the one on common assets, unless they are the same."""
    if everything == common:
        return [everything, "Every method has all of these assets, so no method gains by refusing hard ones."]
    title = "On the assets that are there for every method, so that refusing hard ones gains nothing:"
    return [everything, title, common]


def _overview(rows: Sequence[Row]) -> list[str]:
    attacks = dict.fromkeys(
        row["attack"] + (f" {row['strength']:.3g}" if row["strength"] is not None else "")
        for row in rows
        if row["attack"] != NO_ATTACK
    )
    failed = len(rows) - len(ok(rows))
    first, last = min(row["at"] - row["spent"] for row in rows), max(row["at"] for row in rows)
    lines = {
        "Assets": f"{len({row['sha256'] for row in rows})} ({_distinct(rows, 'dataset')})",
        "Methods": ", ".join(methods(rows)),
        "Watermarks asked for": ", ".join(map(str, counts(rows))),
        "Attacks": ", ".join(attacks) or "none",
        "Rows": f"{len(rows)}, {failed} of them failed",
        "Settings": "; ".join(dict.fromkeys(_settings(row) for row in rows)),
        "Features for SS": _distinct(rows, "semantics"),
        "Machine": _distinct(rows, "machine"),
        "Engine": _distinct(rows, "version"),
        "Time": f"{_duration(busy(rows))} with a process at work, {_duration(sum(row['spent'] for row in rows))} over "
        f"all processes; {_moment(first)} to {_moment(last)}",
    }
    return [
        "Every number below comes from `rows.jsonl`. Lengths are in u: the asset's largest side is 30 u. ↑ higher is "
        "better, ↓ lower is better; ± is half of the 95% interval of the mean by Student's t, which takes assets as "
        "independent draws; **bold** is the best of its block.",
        "## 1. What was run",
        table(["", ""], [[name, value] for name, value in lines.items()]).replace("---:", "---"),
        "Accepted assets by method, and the codes of refusal:",
        tables.acceptance(rows),
    ]


def busy(rows: Sequence[Row]) -> float:
    """Seconds in which at least one process worked on a row: pauses between interrupted runs do not count."""
    total, end = 0.0, float("-inf")
    for start, stop in sorted((row["at"] - row["spent"], row["at"]) for row in rows):
        total += max(0.0, stop - max(start, end))
        end = max(end, stop)
    return total


def _settings(row: Row) -> str:
    return ", ".join(f"{name} {value}" for name, value in row["settings"].items() if value is not None)


def _distinct(rows: Sequence[Row], name: str) -> str:
    return ", ".join(dict.fromkeys(str(row[name]) for row in rows if row.get(name))) or "not measured"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def _moment(at: float) -> str:
    return datetime.fromtimestamp(at, UTC).strftime("%Y-%m-%d %H:%M UTC")


def _pictures(pictures: dict[str, str], *names: str) -> list[str]:
    return [f"![{name}]({pictures[name]})" for name in names if name in pictures]


def _list(sentences: Sequence[str]) -> str:
    return "\n".join(f"- {sentence}" for sentence in sentences)
