"""How many processors there are for this process, by made-up files of control groups."""

import os
from pathlib import Path

import pytest

from core.processors import available_processors

V2 = "31 23 0:27 / /sys/fs/cgroup rw,nosuid - cgroup2 cgroup rw,nsdelegate"
V1 = "33 25 0:29 {root} /sys/fs/cgroup/cpu,cpuacct ro,nosuid master:9 - cgroup cgroup rw,cpu,cpuacct"
HYBRID = "42 32 0:39 / /sys/fs/cgroup/unified rw - cgroup2 cgroup rw"


@pytest.fixture(autouse=True)
def eight_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)))


def machine(root: Path, cgroup: str, mountinfo: str, **files: str) -> Path:
    for name, content in {"proc/self/cgroup": cgroup, "proc/self/mountinfo": mountinfo, **files}.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(content + "\n")
    return root


def v1(folder: str, quota: int) -> dict[str, str]:
    where = f"sys/fs/cgroup/cpu,cpuacct{folder}"
    return {f"{where}/cpu.cfs_quota_us": str(quota), f"{where}/cpu.cfs_period_us": "100000"}


@pytest.mark.parametrize(
    ("quota", "processors"),
    [("200000 100000", 2), ("250000 100000", 2), ("50000 100000", 1), ("max 100000", 8), ("1600000 100000", 8)],
)
def test_a_container_has_what_its_group_may_use(quota: str, processors: int, tmp_path: Path) -> None:
    """`docker run --cpus 2`, version 2: the group is the topmost that is seen."""
    assert available_processors(machine(tmp_path, "0::/", V2, **{"sys/fs/cgroup/cpu.max": quota})) == processors


def test_the_narrowest_of_the_groups_around_counts(tmp_path: Path) -> None:
    """A service of systemd in a slice with a limit of its own."""
    files = {
        "sys/fs/cgroup/meshmark.slice/cpu.max": "300000 100000",
        "sys/fs/cgroup/meshmark.slice/worker.service/cpu.max": "max 100000",
    }
    assert available_processors(machine(tmp_path, "0::/meshmark.slice/worker.service", V2, **files)) == 3


@pytest.mark.parametrize(("quota", "processors"), [(200000, 2), (150000, 1), (-1, 8)])
def test_version_1_in_a_container_whose_path_is_that_of_the_machine(
    quota: int, processors: int, tmp_path: Path
) -> None:
    cgroup = "5:memory:/docker/4f\n4:cpuacct,cpu:/docker/4f\n0::/system.slice"
    mountinfo = f"{HYBRID}\n{V1.format(root='/docker/4f')}\n60 1 8:1 / /data rw - ext4 /dev/sda1 rw,cpu"
    assert available_processors(machine(tmp_path, cgroup, mountinfo, **v1("", quota))) == processors


def test_version_1_outside_of_a_container(tmp_path: Path) -> None:
    cgroup, mountinfo = "4:cpu,cpuacct:/limited", V1.format(root="/")
    assert available_processors(machine(tmp_path, cgroup, mountinfo, **v1("/limited", 400000))) == 4


def test_a_group_outside_of_what_is_mounted_is_taken_for_the_mounted_one(tmp_path: Path) -> None:
    cgroup, mountinfo = "0::/../../other", V2
    assert available_processors(machine(tmp_path, cgroup, mountinfo, **{"sys/fs/cgroup/cpu.max": "100000 100000"})) == 1


@pytest.mark.parametrize("content", ["", "nonsense", "1 2 3", "0 0"])
def test_what_cannot_be_understood_is_no_limit(content: str, tmp_path: Path) -> None:
    assert available_processors(machine(tmp_path, "0::/", V2, **{"sys/fs/cgroup/cpu.max": content})) == 8


def test_without_control_groups_it_is_what_the_process_may_run_on(tmp_path: Path) -> None:
    assert available_processors(tmp_path) == 8


def test_here_it_is_at_least_one_and_no_more_than_the_process_may_run_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    assert 1 <= available_processors() <= len(os.sched_getaffinity(0))
