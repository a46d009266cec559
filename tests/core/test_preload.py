"""What a process is like that has loaded the engine to be forked."""

import json
import os
import subprocess
import sys
from typing import Any

import pytest

SCRIPT = """
import ast, json, os, sys, tempfile
from importlib.util import find_spec
from core.pipeline import preload

preload()
loaded = dict(sys.modules)
files = [os.path.realpath(f"/proc/self/fd/{file}") for file in os.listdir("/proc/self/fd") if int(file) > 2]
state = {
    "threads": len(os.listdir("/proc/self/task")),
    "opened": [path for path in files if not path.startswith("/proc/")],  # what is there are pipes
    "cuda": loaded["torch"].cuda.is_initialized(),
    "temporary folder": tempfile.tempdir,
}

def is_module(name):
    try:
        return find_spec(name)  # which imports what the module is in
    except ModuleNotFoundError:  # and that is no package
        return None

late = set()
for path in [module.__file__ for name, module in loaded.items() if name.startswith("core.")]:
    for function in ast.walk(ast.parse(open(path).read())):
        for node in ast.walk(function) if isinstance(function, ast.FunctionDef) else ():
            if isinstance(node, ast.Import):
                late |= {alias.name for alias in node.names}
            if isinstance(node, ast.ImportFrom):
                late |= {node.module, *filter(is_module, (f"{node.module}.{each.name}" for each in node.names))}
print(json.dumps(state | {"late": sorted(late), "not loaded": sorted(late - set(loaded))}))
"""


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    home = tmp_path_factory.mktemp("home")
    environment = os.environ | {"OMP_NUM_THREADS": "1", "HOME": os.fspath(home), "XDG_CACHE_HOME": os.fspath(home)}
    ended = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, stdout=subprocess.PIPE, check=True)
    return dict(json.loads(ended.stdout), home=list(home.rglob("*")))


def test_whatever_a_function_of_the_engine_imports_is_loaded(loaded: dict[str, Any]) -> None:
    assert {"core.analysis.analyse", "core.metrics.measure", "manifold3d", "pyrender"} <= set(loaded["late"])
    assert set(loaded["not loaded"]) == {"core.geometry.spatial_warp", "warp"}, "for CUDA alone"


def test_it_has_one_thread_and_nothing_open(loaded: dict[str, Any]) -> None:
    assert loaded["threads"] == 1
    assert loaded["opened"] == []
    assert loaded["cuda"] is False
    assert loaded["temporary folder"] is None


def test_loading_the_engine_writes_nothing_and_so_no_library_reports_its_use(loaded: dict[str, Any]) -> None:
    """onnxruntime would make a folder for what it is about to send."""
    assert loaded["home"] == []


def test_the_engine_itself_stays_light_until_it_is_used() -> None:
    script = "import sys, core.pipeline; print(*{'torch', 'onnxruntime', 'igl', 'pyrender', 'cv2'} & set(sys.modules))"
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ended.stdout.split() == []
