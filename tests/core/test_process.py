"""What the engine changes of the process it runs in is said in one place; what it has to tell goes to a log."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CORE = ROOT / "core"
CHANGES = re.compile(r"os\.environ\[[^]]*\] =|os\.environ\.(setdefault|update)|os\.putenv|set_num_threads|infty =")
# The benchmark's parent gives its children other numbers of threads, and takes that back.
EXEMPT = {CORE / "process.py", CORE / "lab" / "benchmark" / "pool.py"}
PRINTS = re.compile(r"traceback\.print_|logging\.basicConfig")


def test_only_one_module_changes_the_process() -> None:
    found = [path.name for path in CORE.rglob("*.py") if path not in EXEMPT and CHANGES.search(path.read_text())]
    assert found == []


def test_nothing_is_printed_by_a_library() -> None:
    assert [path.name for path in CORE.rglob("*.py") if PRINTS.search(path.read_text())] == []


@pytest.mark.parametrize(
    ("statement", "expression", "expected"),
    [
        ("import core", "os.environ['ORT_DISABLE_TELEMETRY']", "1"),
        ("import core.metrics.recognition", "os.environ['ORT_DISABLE_TELEMETRY']", "1"),
        ("import core.placement.finetune, torch", "torch.get_num_threads()", "1"),
        ("from core.rendering.renderer import preload; preload()", "os.environ['PYOPENGL_PLATFORM']", "egl"),
        ("from core.rendering.renderer import preload; preload()", "os.environ['MESA_SHADER_CACHE_DISABLE']", "no"),
        ("import core.pipeline", "os.environ.get('PYOPENGL_PLATFORM', 'untouched')", "untouched"),
    ],
)
def test_each_change_is_made_with_what_needs_it(statement: str, expression: str, expected: str) -> None:
    """What somebody has set for Mesa's cache stays as it is."""
    kept = {name: value for name, value in os.environ.items() if name not in ("PYOPENGL_PLATFORM",)}
    environment = kept | {"ORT_DISABLE_TELEMETRY": "0", "MESA_SHADER_CACHE_DISABLE": "no"}
    code = f"import os; {statement}; print({expression})"
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert (ended.stdout.split(), ended.returncode) == ([expected], 0), ended.stderr
