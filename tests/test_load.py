from pathlib import Path
from typing import Any

import pytest

from tests.load import Load, Outcome, growths, report, run
from tests.worker.engines import asset


def test_jobs_that_come_faster_than_they_are_done_all_end_once_and_whole(tmp_path: Path) -> None:
    load = Load(engine="fast", jobs=60, rate=30, workers=3, uploads=2, upload_mib=5, hang=3.0)
    outcome = run(tmp_path, load)
    print(report(load, outcome))
    assert outcome.complaints == []
    assert outcome.hung is not None
    assert (len(outcome.posts), len(outcome.jobs)) == (60, 62 + outcome.hung.others["202"])
    assert not outcome.errors


class OneRefused(Load):
    def request(self, number: int) -> dict[str, Any]:
        """The first makes a job that fails, the second makes none."""
        odd = [asset("refuse"), b"what is this?"]
        usual = super().request(number)
        return usual | {"files": {"file": ("asset.obj", odd[number])}} if number < len(odd) else usual


def test_a_request_that_is_refused_and_a_job_that_fails_are_complained_of(tmp_path: Path) -> None:
    outcome = run(tmp_path, OneRefused(engine="fast", jobs=4, rate=30, workers=1, uploads=0, hang=0.0))
    refused, failed = sorted(outcome.complaints)
    assert refused == "1 requests ended in unknown_format"
    assert "no_placement" in failed


@pytest.mark.parametrize(("each", "growth"), [(0.0, 0.0), (0.02, 2.0)])
def test_growth_is_that_of_memory_after_the_first_hundred_jobs(each: float, growth: float) -> None:
    grown = [(ended, {"API": 100 + min(ended, 100) + each * ended}) for ended in range(0, 501, 10)]
    assert growths(Outcome(memory=grown))["API"] == pytest.approx(growth)
    assert growths(Outcome(memory=grown[:5])) == {}
