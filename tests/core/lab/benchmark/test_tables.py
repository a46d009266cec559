"""Tables of rows made by hand, against means and intervals worked out by hand."""

from typing import Any

import pytest

from core.lab.benchmark import pairwise as duel
from core.lab.benchmark import tables
from core.lab.benchmark.markdown import best, interval, number, table
from core.lab.benchmark.report import busy, report
from core.lab.benchmark.rows import Row
from core.lab.benchmark.run_time import run_times
from core.lab.benchmark.select import middle_count, ordered, paired
from core.lab.benchmark.statistics import Mean

T2 = 4.302653  # Student's t at 97.5% with two degrees of freedom


def row(asset: str, method: str, count: int = 16, attack: str = "none", **values: Any) -> Row:
    run = values.pop("run", 1.0)
    return {
        "key": f"{asset} {method} {count} {attack}",
        "sha256": asset,
        "asset": asset,
        "dataset": "folder",
        "method": method,
        "count": count,
        "attack": attack,
        "strength": None if attack == "none" else 0.5,
        "status": "ok",
        "vertices": values.pop("vertices", 1000),
        "faces": 2000,
        "marks": count,
        "survived": values.pop("survived", 1.0),
        "metrics": values,
        "missing": {},
        "semantics": "resnet",
        "seconds": {"run": run, "measuring shape": 0.25},
        "settings": {"text": "watermark", "color": None},
        "machine": "a desk",
        "version": "1",
        "at": 100.0,
        "spent": 2.0,
    }


def refused(asset: str, method: str, code: str = "not_manifold", count: int = 16) -> Row:
    left = ("metrics", "seconds", "marks", "survived", "missing", "semantics")
    base = {name: value for name, value in row(asset, method, count).items() if name not in left}
    return base | {"status": "failed", "code": code, "message": "It cannot be."}


def cells(markdown: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in markdown.splitlines()]


ROWS = [
    row("a", "meshmark", ray=1.0, smse=0.002),
    row("b", "meshmark", ray=0.9, smse=0.002),
    row("c", "meshmark", ray=0.8, smse=0.002),
    row("a", "paper", ray=1.0, smse=0.001),
    row("b", "paper", ray=0.6, smse=0.001),
    refused("c", "paper"),
]


def test_the_quality_table_has_means_with_students_interval_and_the_best_in_bold() -> None:
    header, _, ours, theirs = cells(tables.quality(ROWS, 16, only_common=False))
    assert header == ["Method", "Assets", "Marks", "Ray ↑", "SMSE [u] ↓"]
    half = T2 * 0.1 / 3**0.5
    assert ours == ["meshmark", "3", "16", f"**0.900 ± {half:.3f}**", "0.0020"]
    assert theirs[:3] == ["paper", "2", "16"]
    assert theirs[3].startswith("0.800 ± ")
    assert theirs[4] == "**0.0010**"


def test_refusing_a_hard_asset_gains_nothing_in_the_paired_table() -> None:
    _, _, ours, theirs = cells(tables.quality(ROWS, 16, only_common=True))
    assert ours[1] == theirs[1] == "2"
    assert ours[3].startswith("**0.950")
    assert theirs[3].startswith("0.800")


def test_acceptance_counts_refusals_by_their_codes() -> None:
    rows = [*ROWS, refused("d", "paper"), refused("d", "meshmark", "no_placement")]
    assert cells(tables.acceptance(rows))[2:] == [
        ["meshmark", "16", "3 of 4 (75%)", "16", "1 no_placement"],
        ["paper", "16", "2 of 4 (50%)", "16", "2 not_manifold"],
    ]


def test_an_asset_counts_as_common_only_where_every_method_marked_it() -> None:
    assert [(one["asset"], one["method"]) for one in paired(ROWS, ("meshmark", "paper"))] == [
        ("a", "meshmark"),
        ("b", "meshmark"),
        ("a", "paper"),
        ("b", "paper"),
    ]
    assert paired(ROWS, ("meshmark", "li")) == []


def test_the_attack_table_stands_attack_by_attack_with_the_best_of_each_in_bold() -> None:
    rows = [
        *ROWS,
        row("a", "meshmark", attack="crop", ray=0.4, survived=0.25),
        row("a", "paper", attack="crop", ray=0.5, survived=0.5),
    ]
    found = cells(tables.attacks(rows, only_common=False))
    assert found[0] == ["Attack", "Method", "Assets", "Ray ↑", "Marks whole ↑"]
    assert [line[:3] for line in found[2:]] == [
        ["none", "meshmark", "3"],
        ["none", "paper", "2"],
        ["crop 0.5", "meshmark", "1"],
        ["crop 0.5", "paper", "1"],
    ]
    assert found[4][3:] == ["0.400", "0.250"]
    assert found[5][3:] == ["**0.500**", "**0.500**"]


def test_the_invisible_method_stands_beside_the_visible_ones() -> None:
    hidden = row("a", "invisible", 0, ray=0.0, smse=1e-5) | {"marks": None, "bit_accuracy": 0.75}
    found = cells(tables.invisible([*ROWS, hidden], 16).split("\n\n")[0])
    assert found[0] == ["Method", "Assets", "Ray ↑", "SMSE [u] ↓", "Bit accuracy ↑"]
    assert found[-1] == ["invisible", "1", "0", "**1.0e-05**", "0.750"]
    attacked = row("a", "invisible", 0, attack="crop", ray=0.0) | {"marks": None, "bit_accuracy": 0.5}
    rows = [*ROWS, row("a", "meshmark", attack="crop", ray=0.4), hidden, attacked]
    assert [line[:2] for line in cells(tables.attacks(rows, only_common=False))[2:]] == [
        ["none", "meshmark"],
        ["none", "paper"],
        ["none", "invisible"],
        ["crop 0.5", "meshmark"],
        ["crop 0.5", "invisible"],
    ]


def test_our_own_files_are_read_as_clay_and_as_delivered_and_textured_ones_by_themselves_too() -> None:
    rows = [
        row("a", "meshmark", ocr=0.9, ocr_delivered=0.9) | {"textured": False},
        row("b", "meshmark", ocr=0.8, ocr_delivered=0.2) | {"textured": True},
        row("b", "meshmark-default", ocr=0.7, ocr_delivered=0.95) | {"textured": True},
        row("b", "paper", ocr=0.5) | {"textured": True},
    ]
    found = cells(tables.delivered(rows, 16))
    assert found[0] == ["Method", "Assets", "Number", "OCR clay ↑", "OCR as delivered ↑"]
    assert [line[:3] for line in found[2:]] == [
        ["meshmark", "all", "2"],
        ["meshmark-default", "all", "1"],
        ["meshmark", "textured", "1"],
        ["meshmark-default", "textured", "1"],
    ]
    assert found[4][3:] == ["0.800", "0.200"]
    assert cells(tables.delivered_by_asset(rows, 16)) == [
        ["Asset", "Textures", "meshmark", "meshmark-default"],
        ["---", "---:", "---:", "---:"],
        ["b", "yes", "0.800 / 0.200", "0.700 / 0.950"],
        ["a", "-", "0.900 / 0.900", "-"],
    ]
    assert "0.800 / 0.200" in report(rows, {})


def test_where_nothing_was_read_as_delivered_the_report_says_so() -> None:
    assert "No file was read as it is delivered." in report(ROWS, {})


def test_the_mesh_statistics_stand_beside_the_papers() -> None:
    rows = [row("a", "meshmark", vertices=100), row("a", "paper", vertices=100), row("b", "paper", vertices=400)]
    found = cells(tables.mesh_statistics(rows))
    assert found[2] == ["folder (this run)", "2", "100", "400", "250.0", "2,000", "2,000", "2,000.0"]
    assert found[3][:5] == ["Manifold40 (the paper's)", "50", "6,561", "137,055", "56,943.2"]


def test_the_papers_own_tables_are_printed_as_published() -> None:
    assert "| Meshy | paper | **0.411** | **0.993** | **0.526** | **0.0017** |" in tables.published_quality()
    assert "| paper-no-optimization | 0.225 | 0.543 | 0.232 | 0.0050 | **3.800** |" in tables.published_ablation()
    assert "| removal | li | 0.541 | 0.211 | **20.4** | 0.918 |" in tables.published_attacks()


def test_the_run_time_table_gives_the_fitted_exponent_and_the_papers_times() -> None:
    sizes = (10**3, 10**4, 10**5)
    rows = [row(str(size), "meshmark", vertices=size, run=0.01 * size**0.5) for size in sizes]
    found = cells(run_times(rows, 16))
    assert found[2][0:3] == ["meshmark", "3", "1,000 to 100,000"]
    assert found[2][5].startswith("0.500 ± ")
    assert found[2][6:] == [f"{0.01 * size**0.5:.1f}" for size in (60_000, 1_200_000)]
    assert found[3][-2:] == ["30", "180"]


def test_where_ours_is_worse_is_told_by_metric_and_asset() -> None:
    score = {line[0]: line[1:] for line in cells(duel.score(ROWS, 16, "meshmark", "paper"))[2:]}
    assert score["Ray ↑"][:3] == ["1", "1", "0"]
    assert score["SMSE [u] ↓"] == ["0", "0", "2", "0.0010", "a, b"]
    assert cells(duel.per_asset(ROWS, 16, "meshmark", "paper"))[2] == ["a", "1.000 / 1.000", "**0.0020 / 0.0010**"]
    (sentence,) = duel.losses(ROWS, 16, "meshmark")
    assert sentence.startswith("Without an attack, SMSE [u] ↓: meshmark 0.0020, paper 0.0010 on 2 common assets")


def test_the_middle_count_is_where_methods_are_compared() -> None:
    assert middle_count([row("a", "li", count) for count in (32, 4, 16)] + [row("a", "invisible", 0)]) == 16


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.8444, "0.844"), (0.0017, "0.0017"), (7.81e-9, "7.8e-09"), (20.525, "20.5"), (1234.5, "1,234.5")],
)
def test_numbers_are_short_and_tiny_ones_keep_their_size(value: float, text: str) -> None:
    assert number(value) == text


def test_all_that_read_the_same_as_the_best_are_bold() -> None:
    means = [Mean(0.5001, None, 1), Mean(0.4999, 0.1, 3), Mean(0.2, None, 1), None]
    assert best(means, higher=True) == ["**0.500**", "**0.500 ± 0.100**", "0.200", "-"]
    assert best(means, higher=False)[2] == "**0.200**"
    assert interval(None) == "-"


def test_a_name_with_a_bar_does_not_break_a_table() -> None:
    assert table(["a", "b"], [["x|y", "1"]]).splitlines()[-1] == "| x\\|y | 1 |"


def test_pauses_between_interrupted_runs_are_no_working_time() -> None:
    rows = [{"at": 10.0, "spent": 10.0}, {"at": 12.0, "spent": 5.0}, {"at": 1000.0, "spent": 3.0}]
    assert busy(rows) == pytest.approx(15.0)


def test_the_report_does_not_depend_on_the_order_in_which_rows_came() -> None:
    assert report(ordered(ROWS), {}) == report(ordered(ROWS[::-1]), {})


def test_a_benchmark_in_which_nothing_succeeded_still_has_a_report() -> None:
    text = report([refused("a", "meshmark"), refused("a", "paper")], {})
    assert "0 of 1 (0%)" in text
    assert "No asset was marked by both meshmark and paper." in text


def test_resistance_is_the_share_of_assets_that_a_thief_did_not_strip() -> None:
    thief = [
        row("a", "meshmark", attack="thief-strip", recovered=0.95, stripped=1.0, ocr=0.1, ocr_relief=0.1, ss=0.9),
        row("b", "meshmark", attack="thief-strip", recovered=0.95, stripped=0.0, ocr=0.1, ocr_relief=0.8, ss=0.9),
        row("c", "meshmark", attack="thief-strip", recovered=-2.0, stripped=0.0, ocr=0.5, ocr_relief=0.9, ss=0.9),
    ]
    (line,) = cells(tables.removal_resistance([*ROWS, *thief]))[2:]
    assert line[:5] == ["thief-strip", "meshmark", "67%", "2 of 3", "0.95"]
    assert tables.removal_resistance(ROWS) == "No thief was let in."
