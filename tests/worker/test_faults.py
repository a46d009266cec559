from pathlib import Path

from tests import faults


def test_whatever_fails_every_accepted_job_ends_once_and_whole_and_nothing_is_left(tmp_path: Path) -> None:
    counts = faults.run(tmp_path, jobs=50)
    print(*counts.items(), sep="\n")
    assert counts["jobs accepted"] == 50
    assert counts["jobs that succeeded"] >= 47
    assert counts["requests that were sent again"] > 0
    assert counts["times that jobs were put back or announced again"] > 0
