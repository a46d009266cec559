"""Which part of the house may use which, and how large its rooms are."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from graphlib import TopologicalSorter
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("core", "service", "worker")

# Of each folder, and each file beside the folders of core, all that it imports of core: no more and no less. What every
# part may use (arrays, choices, errors, notices, and the version) is not listed.
BELOW = {
    "budgets": "",
    "refusals": "",
    "languages": "",
    "named_regions": "validation",
    "labels": "validation",
    "preview_model": "validation",
    "parameters": "labels languages named_regions preview_model validation",
    "geometry": "",
    "device": "geometry",
    "gltf": "geometry budgets refusals",
    "formats": "gltf geometry budgets refusals",
    "artwork": "geometry labels parameters",
    "analysis": "gltf geometry device named_regions parameters",
    "placement": "analysis artwork gltf geometry parameters process",
    "embossing": "placement analysis artwork gltf geometry parameters",
    "rendering": "gltf geometry process",
    "models": "",
    "metrics": "placement analysis artwork rendering geometry models processors",
    "report": "artwork embossing gltf parameters",
    "reporting": "report stages metrics embossing geometry parameters device",
    "preload": "rendering",
    "plan": "parameters validation",
    "stages": "plan embossing placement analysis artwork formats gltf labels rendering budgets parameters",
    "marking": "stages embossing placement analysis artwork formats gltf geometry labels parameters budgets",
    "lightening": "marking stages analysis gltf preview_model",
    "planned": "marking plan stages embossing placement analysis artwork gltf geometry parameters validation",
    "measuring": "explain stages report reporting metrics rendering analysis",
    "exporting": "stages formats labels",
    "pipeline": (
        "exporting explain lightening marking measuring plan planned stages formats budgets parameters preload"
    ),
    "series": "pipeline marking stages budgets parameters",
    "conversion": "formats gltf budgets",
    "evaluate": "report reporting metrics rendering analysis formats gltf geometry budgets",
    "lab": (
        "pipeline preload stages report metrics rendering placement analysis artwork formats gltf geometry budgets "
        "parameters processors validation"
    ),
    "credentials": "report",
    "verify": (
        "credentials evaluate report reporting metrics rendering artwork labels formats gltf geometry budgets device "
        "validation"
    ),
    "explain": "marking stages reporting embossing placement rendering formats gltf geometry budgets parameters",
    "doctor": "pipeline rendering artwork models device",
    "cli": (
        "doctor explain formats lab pipeline series preload verify evaluate models labels parameters process "
        "processors validation"
    ),
    "__init__": "process",
}
EVERYWHERE = {"arrays", "choices", "errors", "notices", "__version__"}

# Of core, the service and the worker use these; the worker alone the reading of uploads.
OF_SERVICE = {
    *{
        "choices",
        "errors",
        "validation",
        "parameters",
        "budgets",
        "artwork",
        "report",
        "credentials",
        "verify",
        "__version__",
    }
}
OF_WORKER = OF_SERVICE | {"conversion", "doctor", "formats", "pipeline", "plan", "preload", "processors"}

FILE_LINES = 400
PARAMETERS = 7

# Functions of many parameters with a reason.
WIDE_FUNCTIONS = {
    "core/pipeline.py:watermark",  # the whole of a request
    "core/geometry/warp_kernels.py:first_hit",  # a kernel: it takes arrays and numbers, no records
    # Commands take a parameter for each option.
    *(
        f"core/cli/{name}.py:{name}"
        for name in ("apply", "attack", "benchmark", "evaluate", "explain", "sizing", "study", "verify")
    ),
}


def sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def imported(path: Path) -> Iterator[str]:
    """The dotted names that a file imports of this project, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        match node:
            case ast.ImportFrom(module=str(module), level=0):
                names = [module] if "." in module else [f"{module}.{alias.name}" for alias in node.names]
            case ast.Import():
                names = [alias.name for alias in node.names]
            case _:
                names = []
        yield from (name for name in names if name.split(".")[0] in PACKAGES)


def part(path: Path) -> str:
    """The folder of a package that a file lies in, or its own name where it lies beside the folders."""
    return path.relative_to(ROOT).with_suffix("").parts[1]


def used_by_core() -> dict[str, set[str]]:
    found = defaultdict[str, set[str]](set)
    for path in sources("core"):
        names = (name.split(".") for name in imported(path))
        found[part(path)] |= {name[1] for name in names if name[0] == "core"} - {part(path)} - EVERYWHERE
    return {name: parts for name, parts in found.items() if parts or name in BELOW}


def test_each_part_of_the_engine_uses_those_below_it_and_no_others() -> None:
    assert used_by_core() == {name: set(below.split()) for name, below in BELOW.items()}


def test_no_two_parts_of_the_engine_use_each_other() -> None:
    list(TopologicalSorter(used_by_core()).static_order())  # raises where there is a circle


def modules(package: str) -> dict[str, set[str]]:
    """The modules of this package that each of its modules imports when it is loaded."""
    known = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in sources(package)
    }
    graph = {}
    for path in sources(package):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        at_once = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.ImportFrom)]
        targets = chain.from_iterable(
            [str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)] for node in at_once
        )
        graph[name] = known.intersection(targets) - {name}
    return graph


@pytest.mark.parametrize("package", PACKAGES)
def test_no_two_modules_import_each_other(package: str) -> None:
    list(TopologicalSorter(modules(package)).static_order())


def test_the_engine_knows_no_service_and_the_service_no_worker() -> None:
    assert [name for path in sources("core") for name in imported(path) if not name.startswith("core")] == []
    assert [name for path in sources("service") for name in imported(path) if name.startswith("worker")] == []


def test_the_client_uses_nothing_of_the_house_and_nothing_there_uses_it() -> None:
    of_client = {name for path in sources("service") if part(path) == "client" for name in imported(path)}
    elsewhere = {
        name for path in sources("service") + sources("worker") if part(path) != "client" for name in imported(path)
    }
    assert [name for name in of_client if not name.startswith("service.client.")] == []
    assert [name for name in elsewhere if name.startswith("service.client")] == []


@pytest.mark.parametrize(("package", "allowed"), [("service", OF_SERVICE), ("worker", OF_WORKER)])
def test_of_the_engine_only_its_entrances_are_used(package: str, allowed: set[str]) -> None:
    names = {name.split(".")[1] for path in sources(package) for name in imported(path) if name.startswith("core")}
    assert names <= allowed


def test_what_service_and_worker_share_knows_no_routes() -> None:
    below = ("service.routes", "service.app", "service.console")
    shared = [path for path in sources("service") if part(path) in ("jobs", "hooks", "webhooks", "outbound")]
    assert [(path.name, name) for path in shared for name in imported(path) if name.startswith(below)] == []


def test_files_of_the_engine_are_short() -> None:
    long = [path.name for path in sources("core") if len(path.read_text().splitlines()) > FILE_LINES]
    assert long == []


def width(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """The parameters of a function, without that of its object."""
    arguments = function.args
    names = [each.arg for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    return len(names) - (names[:1] in (["self"], ["cls"])) + (arguments.vararg is not None)


def test_functions_of_the_engine_take_few_things() -> None:
    wide = {
        f"{path.relative_to(ROOT)}:{node.name}"
        for path in sources("core")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and width(node) > PARAMETERS
    }
    assert wide == WIDE_FUNCTIONS
