"""No test depends on how fast the machine is: what happens is waited for, with patience, and nothing is measured."""

import re
from pathlib import Path

from hypothesis import HealthCheck, settings

TESTS = Path(__file__).parent
OURS = [path for path in TESTS.rglob("*.py") if "node_modules" not in path.parts and path != Path(__file__)]


def test_no_example_has_a_deadline() -> None:
    assert settings.default is not None
    assert settings.default.deadline is None
    assert HealthCheck.too_slow in settings.default.suppress_health_check
    assert [path.name for path in OURS if path.name != "conftest.py" and "deadline=" in path.read_text()] == []


def test_no_test_measures_how_long_something_takes() -> None:
    clocks = re.compile(r"time\.(monotonic|perf_counter|process_time)(_ns)?\(|timeit")
    assert [path.name for path in OURS if path.name.startswith("test_") and clocks.search(path.read_text())] == []


def test_whatever_is_waited_for_has_the_patience_of_all() -> None:
    """Numbers of seconds that end a wait: only in what is meant to end there, which is written as a decimal."""
    short = re.compile(r"(?:\.(?:wait|join|settimeout)\(|\btimeout=|\bwait_until\(.*, )(\d+)\)")
    found = [
        (path.name, match[0])
        for path in OURS
        if path.name.startswith("test_")
        for match in short.finditer(path.read_text())
    ]
    assert found == []
