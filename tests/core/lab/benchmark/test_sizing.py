import json
from pathlib import Path
from typing import Any

import pytest

from core.cli import main
from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.queueing import Effort
from core.lab.benchmark.sizing import Share, markdown, parse_mix, sizing, without_metrics

LITTLE = Effort(runs=10, arrivals=500, warm_up=500)


def profile(**seconds: float) -> dict[str, Any]:
    """Assets of 100, 10,000 and 1,000,000 faces that take so long, and one that was refused."""
    faces = {"small": 100, "medium": 10_000, "large": 1_000_000}
    assets: list[dict[str, Any]] = [
        {"status": "ok", "faces": faces[name], "seconds": {"placing": taken / 2, "embossing": taken / 2}}
        for name, taken in seconds.items()
    ]
    return {"schema": "meshmark.profile/1", "assets": [*assets, {"status": "refused", "code": "no_placement"}]}


def test_the_busy_workers_are_arrivals_times_the_mean_of_the_mix() -> None:
    measured = profile(small=1.0, medium=2.0, large=10.0)
    mix = parse_mix("1000:70,100000:20,inf:10")
    (found,) = sizing(measured, [3600], mix=mix, overhead=0.5, effort=LITTLE)
    assert found.load == pytest.approx(0.7 * 1 + 0.2 * 2 + 0.1 * 10 + 0.5)
    assert found.workers > found.load
    (alike,) = sizing(measured, [3600], effort=LITTLE)
    assert alike.load == pytest.approx(13 / 3)


def test_a_shorter_wait_takes_more_workers_and_more_arrivals_take_fewer_each() -> None:
    measured = profile(small=2.0, medium=3.0)
    patient, hasty = (sizing(measured, [36_000], wait=wait, busy=0.95, effort=LITTLE)[0] for wait in (30.0, 0.01))
    assert patient.wait[1] <= 30
    assert hasty.wait[1] <= 0.01
    assert hasty.workers > patient.workers > patient.load
    few, many = sizing(measured, [3600, 72_000], wait=0.5, effort=LITTLE)
    assert many.workers / many.load < few.workers / few.load


def test_quantiles_rise_and_results_take_longer_than_waits() -> None:
    (found,) = sizing(profile(small=2.0, large=20.0), [5000], effort=LITTLE)
    assert list(found.wait) == sorted(found.wait)
    assert all(result > wait for result, wait in zip(found.result, found.wait, strict=True))


@pytest.mark.parametrize("text", ["", "1000", "1000:70:1", "a:1", "1000:1,100:1", "1000:-1", "1000:0", "1:1,1:1"])
def test_what_is_no_mix_is_refused(text: str) -> None:
    with pytest.raises(MeshmarkError) as caught:
        parse_mix(text)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS


def test_what_cannot_be_sized_is_refused() -> None:
    measured = profile(small=1.0)
    with pytest.raises(MeshmarkError, match="no profile"):
        sizing({"schema": "other"}, [1])
    with pytest.raises(MeshmarkError, match="no profile"):
        without_metrics({"schema": "other"})
    with pytest.raises(MeshmarkError, match="no asset"):
        sizing(measured, [1], mix=[Share(50, 1), Share(1000, 1)])
    with pytest.raises(MeshmarkError, match="Arrivals must"):
        sizing(measured, [0])
    for wait, overhead, busy in ((-1.0, 0.0, 0.9), (1.0, -1.0, 0.9), (1.0, 0.0, 0.96), (1.0, 0.0, 0.0)):
        with pytest.raises(MeshmarkError, match="Arrivals must"):
            sizing(measured, [1], wait=wait, overhead=overhead, busy=busy)


def test_without_metrics_jobs_end_with_the_model() -> None:
    stages = dict.fromkeys(("reading", "lettering", "placing", "embossing", "writing"), 1.0)
    whole = {"status": "ok", "faces": 12, "seconds": stages | {"rendering": 3.0, "evaluating": 7.0}}
    measured = {"schema": "meshmark.profile/1", "assets": [whole, {"status": "failed", "code": "no_placement"}]}
    loads = [sizing(each, [3600], effort=LITTLE)[0].load for each in (measured, without_metrics(measured))]
    assert loads == [15, 5]


def test_workers_are_not_busier_than_allowed_however_many_they_are() -> None:
    for busy in (0.5, 0.9):
        (found,) = sizing(profile(small=2.0), [100_000], wait=1000, busy=busy, effort=LITTLE)
        assert found.load / found.workers <= busy < found.load / (found.workers - 1)


def test_the_command_prints_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "profile.json"
    path.write_text(json.dumps(profile(small=1.0, medium=2.0)))
    arguments = ["--profile", str(path), "--arrivals", "1000,2000", "--mix", "1000:3,inf:1", "--p95-wait", "5"]
    assert main(["sizing", *arguments, "--overhead", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    found = sizing(json.loads(path.read_text()), [1000, 2000], mix=parse_mix("1000:3,inf:1"), wait=5, overhead=1)
    assert lines == markdown(found, 5, 0.9).splitlines()
    assert lines[2].startswith("| 1,000 | 24,000 |")
    assert main(["sizing", "--profile", str(tmp_path / "nothing"), "--arrivals", "1"]) == 66
    path.write_text("no JSON")
    assert main(["sizing", "--profile", str(path), "--arrivals", "1"]) == 2
