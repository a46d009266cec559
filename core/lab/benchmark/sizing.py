"""Number of workers for a marketplace: measured service times, a mix of sizes, and a simulated queue."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.markdown import number, table
from core.lab.benchmark.profile import SCHEMA, TO_THE_MODEL
from core.lab.benchmark.queueing import Draw, Effort, fewest_workers, waits

HOUR = 3600.0


@dataclass(frozen=True)
class Share:
    """Of all uploads, this share has up to so many faces, and more than the share before."""

    faces: float
    share: float


EVERYTHING = (Share(float("inf"), 1.0),)


@dataclass(frozen=True)
class Sizing:
    """Workers for a rate of arrivals, and the resulting waits.

    Attributes:
        arrivals: an hour.
        load: workers that are busy on average.
        workers: number needed.
        wait: seconds until the start, at the median, of 95% and of 99% of the jobs.
        result: seconds until the result, likewise.
    """

    arrivals: float
    load: float
    workers: int
    wait: tuple[float, float, float]
    result: tuple[float, float, float]


def sizing(
    profile: dict[str, Any],
    arrivals: Sequence[float],
    *,
    mix: Sequence[Share] = EVERYTHING,
    wait: float = 30.0,
    busy: float = 0.9,
    overhead: float = 0.0,
    effort: Effort | None = None,
) -> list[Sizing]:
    """The workers that arrivals an hour take, one job at a time each, on machines like the profile's.

    Args:
        profile: ``meshmark.profile/1``; each upload takes as long as an asset of it drawn by chance.
        arrivals: an hour, evenly by chance over the hour (Poisson).
        mix: shares by faces; by default, every asset of the profile is as likely.
        wait: seconds that 95% of the jobs may wait until they start.
        busy: the largest share of the workers that may be busy on average: the rest is for uneven hours.
        overhead: seconds a job takes beside the engine: its process starts, files come and go.
        effort: of the simulation.

    Raises:
        MeshmarkError: ``invalid_parameters`` for an invalid profile, mix or amount.
    """
    effort = effort or Effort()
    seconds, chance = _service_times(profile, mix)
    seconds = seconds + overhead
    if wait < 0 or overhead < 0 or not arrivals or min(arrivals) <= 0 or not 0 < busy <= 0.95:
        raise _refused(
            "Arrivals must be more than 0, wait and overhead not less, and busy more than 0 and at most 0.95.",
            "Correct the amounts.",
        )

    def draw(random: np.random.Generator, shape: tuple[int, int]) -> NDArray[np.float64]:
        return random.choice(seconds, shape, p=chance)

    mean = float(seconds @ chance)
    return [_sized(each, draw, mean, wait, busy, effort) for each in arrivals]


def without_metrics(profile: dict[str, Any]) -> dict[str, Any]:
    """A ``meshmark.profile/1`` as of jobs with ``evaluate: none``: with the stages up to the written model alone.

    Raises:
        MeshmarkError: ``invalid_parameters`` for an invalid profile.
    """
    _require_profile(profile)
    assets = [
        asset | {"seconds": {stage: asset["seconds"][stage] for stage in TO_THE_MODEL}}
        if asset["status"] == "ok"
        else asset
        for asset in profile["assets"]
    ]
    return profile | {"assets": assets}


def parse_mix(text: str) -> tuple[Share, ...]:
    """``10000:70,100000:25,inf:5``: of all uploads, 70 parts up to 10,000 faces, 25 up to 100,000, the rest above.

    Raises:
        MeshmarkError: ``invalid_parameters``.
    """
    try:
        pairs = [tuple(map(float, part.split(":"))) for part in text.split(",")]
        shares = tuple(Share(faces, share) for faces, share in pairs)
    except (ValueError, TypeError):
        raise _refused(f"{text!r} is no mix.", "Write it as FACES:SHARE,..., such as 10000:70,inf:30.") from None
    bounds = [item.faces for item in shares]
    if bounds != sorted(set(bounds)) or min(item.share for item in shares) < 0 or not sum(i.share for i in shares) > 0:
        raise _refused(f"{text!r} is no mix.", "Let faces rise, and shares be positive.")
    return shares


def markdown(found: Sequence[Sizing], wait: float, busy: float) -> str:
    """The table of a sizing."""
    head = ("Uploads an hour", "a day", "busy workers", "workers", "wait p50 [s]", "p95", "p99", "result p95 [s]")
    lines = [
        (
            f"{item.arrivals:,.0f}",
            f"{24 * item.arrivals:,.0f}",
            f"{item.load:.1f}",
            str(item.workers),
            *(f"{seconds:.1f}" for seconds in item.wait),
            f"{item.result[1]:.1f}",
        )
        for item in found
    ]
    promise = f"Workers for a wait of at most {number(wait)} s in 95 of 100 cases, busy {busy:.0%} of the time at most."
    return f"{table(head, lines)}\n\n{promise}\n"


def _require_profile(profile: dict[str, Any]) -> None:
    if profile.get("schema") != SCHEMA:
        raise _refused("This is no profile.", "Give the profile.json that `meshmark profile DIR --out OUT` wrote.")


def _service_times(profile: dict[str, Any], mix: Sequence[Share]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Seconds of each asset, and the probability that an upload is like it."""
    _require_profile(profile)
    assets = [asset for asset in profile["assets"] if asset["status"] == "ok"]
    faces = np.array([asset["faces"] for asset in assets], dtype=float)
    seconds = np.array([sum(asset["seconds"].values()) for asset in assets])
    chance = np.zeros(len(assets))
    below = -1.0
    for item in mix:
        inside = (faces > below) & (faces <= item.faces)
        if item.share and not inside.any():
            raise _refused(
                f"The profile has no asset with {below + 1:,.0f} to {item.faces:,.0f} faces.",
                "Profile some of that size, or choose other bounds.",
            )
        chance[inside] = item.share / max(inside.sum(), 1)
        below = item.faces
    return seconds, chance / chance.sum()


def _sized(arrivals: float, draw: Draw, mean: float, wait: float, busy: float, effort: Effort) -> Sizing:
    rate = arrivals / HOUR
    workers = fewest_workers(rate, draw, mean, wait, effort, busy)
    waited, work = waits(rate, draw, workers, effort)
    shares = (0.5, 0.95, 0.99)
    first, second, third = (float(np.quantile(waited, share)) for share in shares)
    result = tuple(float(np.quantile(waited + work, share)) for share in shares)
    return Sizing(arrivals, rate * mean, workers, (first, second, third), (result[0], result[1], result[2]))


def _refused(message: str, remedy: str) -> MeshmarkError:
    return MeshmarkError(ErrorCode.INVALID_PARAMETERS, message, remedy)
