"""Number of processors of this process: those it may run on, within the quota of its control group."""

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath


def available_processors(root: Path = Path("/")) -> int:
    """Number of processors, at least one; of a quota that is no whole number, the whole number below.

    Args:
        root: folder of ``proc`` and ``sys``.
    """
    mine = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min([mine, *map(int, _quotas(root))]))


def _quotas(root: Path) -> Iterator[float]:
    """The processors that this process's control group and those around it may use, where they have a limit.

    cgroups(7): version 2 has both numbers in one file, version 1 in two, as the kernel's documents of
    ``cgroup-v2`` and ``sched-bwc`` say. A container sees its own group at the mount point, or its path below it.
    """
    for mount, group in _mounts(root):
        for folder in (mount / group, *(mount / parent for parent in group.parents)):
            with suppress(OSError, ValueError):  # no limit is `max` or -1; the topmost group has no such file
                yield _quota(root / folder.relative_to("/"))


def _quota(folder: Path) -> float:
    if (both := folder / "cpu.max").exists():
        quota, period = both.read_text().split()
    else:
        quota, period = ((folder / f"cpu.cfs_{name}_us").read_text() for name in ("quota", "period"))
    if int(quota) <= 0 or int(period) <= 0:
        raise ValueError
    return int(quota) / int(period)


def _mounts(root: Path) -> Iterator[tuple[PurePosixPath, PurePosixPath]]:
    """Mount points of control groups with quotas of processors, and this process's group at each."""
    try:
        lines = (root / "proc/self/cgroup").read_text().splitlines()
        mounts = (root / "proc/self/mountinfo").read_text().splitlines()
    except OSError:  # another system than Linux
        return
    groups = {
        frozenset(controllers.split(",")): path for _, controllers, path in (line.split(":", 2) for line in lines)
    }
    for line in mounts:
        # proc(5): ID, parent, device, root, mount point, options, fields of any number, a dash, type, source, options.
        found = re.fullmatch(r"\S+ \S+ \S+ (\S+) (\S+) .*? - (cgroup2?) \S+ (\S+)", line)
        if not found:
            continue
        top, point, kind, options = found.groups()
        for controllers, path in groups.items():
            mine = controllers == {""} if kind == "cgroup2" else "cpu" in controllers & set(options.split(","))
            if mine:
                inside = PurePosixPath(path).is_relative_to(top)
                yield PurePosixPath(point), PurePosixPath(path).relative_to(top) if inside else PurePosixPath()
