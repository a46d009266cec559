"""Archives and formats of several bodies, from the upload to the report."""

import os
from pathlib import Path

import pytest

from core.choices import Evaluate
from core.errors import ErrorCode
from core.parameters import Parameters
from core.pipeline import watermark
from tests.core.formats.samples import OBJ, SAMPLES, png, zipped
from tests.validator import error_counts

MESHES = Path(os.environ.get("MESHMARK_TEST_MESHES", "../shared/meshes"))
FACTS = ("watertight", "components", "boundary_edges", "nonmanifold_edges")
FEW = Parameters(text="ok", count=2, size=1.5, evaluate=Evaluate.GEOMETRY)
# files whose largest place is narrower than the presets try
SIZES = {"dodeca-chain-color.3mf": 0.8}
FILES = [path for pattern in ("*.zip", "*.3mf", "*.dae") for path in sorted(MESHES.glob(pattern))]


@pytest.mark.parametrize(
    "name", ["gltf", "gltf+zip", "obj+zip", "3mf", "dae", "dae+zip", "off-binary", "ply-strips", "3mf+zip", "ply+zip"]
)
def test_every_format_is_marked_and_named_in_the_report(name: str) -> None:
    result = watermark(SAMPLES[name], FEW, preview=False)
    asset, model = result.report["asset"], result.report["model"]
    assert asset["format"] == name.partition("-")[0]
    assert len(result.report["watermarks"]) == 2
    assert {fact: asset[fact] for fact in FACTS} == {fact: model[fact] for fact in FACTS}
    assert result.report["metrics"]["asset_utility"]["ipe"] == 0
    assert not error_counts(result.model)


def test_what_could_not_be_carried_is_a_warning_of_the_report() -> None:
    data = zipped({"cube.obj": OBJ, "a.png": png(1, 2, 3), "b.png": png(3, 2, 1)})
    warnings = watermark(data, FEW, preview=False).report["warnings"]
    assert [warning["code"] for warning in warnings] == [ErrorCode.UNSUPPORTED_FEATURE] * 2
    assert "passwd" in warnings[0]["message"]
    assert "2 images" in warnings[1]["message"]
    assert all(warning["remedy"].endswith(".") for warning in warnings)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_a_real_archive_is_marked_without_changing_its_topology(path: Path) -> None:
    parameters = Parameters(text="watermark", count=3, size=SIZES.get(path.name), evaluate=Evaluate.GEOMETRY)
    result = watermark(path.read_bytes(), parameters, preview=False)
    asset, model = result.report["asset"], result.report["model"]
    assert {fact: asset[fact] for fact in FACTS} == {fact: model[fact] for fact in FACTS}
    assert result.report["metrics"]["asset_utility"]["ipe"] == 0
    # The links of a chain have room for small text alone, and the report says so.
    small = ["small_text"] if path.name in SIZES else []
    assert [warning["code"] for warning in result.report["warnings"]] == small
    assert not error_counts(result.model)
