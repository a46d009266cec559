"""Comparison of two methods asset by asset."""

from collections.abc import Sequence

from core.lab.benchmark.markdown import METRICS, NOTHING, interval, number, table
from core.lab.benchmark.options import NO_ATTACK
from core.lab.benchmark.rows import Row
from core.lab.benchmark.select import methods, ok, paired, unattacked, values, visible
from core.lab.benchmark.statistics import mean
from core.lab.benchmark.tables import ATTACKED, QUALITY, of_method

Pair = tuple[float, float]


def per_asset(rows: Sequence[Row], count: int, ours: str, theirs: str) -> str:
    """Every metric of both methods on every asset (``ours / theirs``), bold where ours is worse."""
    both = _by_asset(unattacked(rows, count), ours, theirs)
    if not both:
        return f"No asset was marked by both {ours} and {theirs}."
    shown = [name for name in QUALITY if any(_pair(one, name) for one in both)]
    body = [[one[0]["asset"], *(_cell(_pair(one, name), METRICS[name].higher) for name in shown)] for one in both]
    return table([f"Asset ({ours} / {theirs})", *(METRICS[name].heading for name in shown)], body)


def score(rows: Sequence[Row], count: int, ours: str, theirs: str) -> str:
    """By metric: the number of assets on which ours is better, equal or worse, and the mean difference."""
    both = _by_asset(unattacked(rows, count), ours, theirs)
    body = []
    for name in QUALITY:
        pairs = [pair for one in both if (pair := _pair(one, name))]
        if not pairs:
            continue
        gains = [_gain(pair, METRICS[name].higher) for pair in pairs]
        worse = [one[0]["asset"] for one in both if (pair := _pair(one, name)) and _worse(pair, METRICS[name].higher)]
        body.append(
            [
                METRICS[name].heading,
                str(sum(gain > 0 for gain in gains)),
                str(sum(gain == 0 for gain in gains)),
                str(len(worse)),
                interval(mean([mine - other for mine, other in pairs])),
                ", ".join(worse) or NOTHING,
            ]
        )
    return table(["Metric", "Better", "Equal", "Worse", f"{ours} minus {theirs}", "Worse on"], body)


def losses(rows: Sequence[Row], count: int, ours: str) -> list[str]:
    """A sentence for every mean in which another visible method beats ``ours`` on the assets both marked."""
    found = []
    kinds = dict.fromkeys((row["attack"], row["strength"], row["count"]) for row in visible(rows))
    for attack, strength, at in kinds:
        if attack == NO_ATTACK and at != count:
            continue
        kind = (attack, strength, at)
        here = [row for row in visible(rows) if (row["attack"], row["strength"], row["count"]) == kind]
        name = "Without an attack" if attack == NO_ATTACK else f"After {attack}"
        name += f" {strength:.3g}" if strength is not None else ""
        for theirs in methods(here):
            if theirs == ours:
                continue
            common = paired(here, (ours, theirs))
            for metric in QUALITY if attack == NO_ATTACK else ATTACKED:
                mine, other = (mean(values(of_method(common, method), metric)) for method in (ours, theirs))
                if mine and other and _worse((mine.value, other.value), METRICS[metric].higher):
                    both = _by_asset(common, ours, theirs)
                    pairs = [pair for one in both if (pair := _pair(one, metric))]
                    gap = interval(mean([own - alien for own, alien in pairs]))
                    found.append(
                        f"{name}, {METRICS[metric].heading}: {ours} {number(mine.value)}, {theirs} "
                        f"{number(other.value)} on {len(pairs)} common assets; paired difference {gap}."
                    )
    return found


def _by_asset(rows: Sequence[Row], ours: str, theirs: str) -> list[tuple[Row, Row]]:
    """The rows of both methods on each asset that both marked, by the asset's name."""
    first, second = ({row["sha256"]: row for row in ok(rows) if row["method"] == method} for method in (ours, theirs))
    both = [(first[sha256], second[sha256]) for sha256 in first if sha256 in second]
    return sorted(both, key=lambda pair: pair[0]["asset"])


def _pair(one: tuple[Row, Row], metric: str) -> Pair | None:
    mine, other = (values([row], metric) for row in one)
    return (mine[0], other[0]) if mine and other else None


def _gain(pair: Pair, higher: bool) -> float:
    return pair[0] - pair[1] if higher else pair[1] - pair[0]


def _worse(pair: Pair, higher: bool) -> bool:
    return _gain(pair, higher) < 0


def _cell(pair: Pair | None, higher: bool) -> str:
    if pair is None:
        return NOTHING
    text = f"{number(pair[0])} / {number(pair[1])}"
    return f"**{text}**" if _worse(pair, higher) else text
