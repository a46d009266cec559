"""The page of a study shows two methods without a word about them."""

import base64
import hashlib
import json
import re
from pathlib import Path
from typing import Any

import pytest

from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.options import BenchmarkOptions
from core.lab.benchmark.results import write_results
from core.lab.study import trials as module
from core.lab.study.answers import read_key
from core.lab.study.page import study_page, write_study
from core.lab.study.trials import LEVEL, Trial, chosen_rows, read_results, trials

BOTH = ("meshmark", "meshmark-flat")
BOX = b"v 0 0 0\nv 9 0 0\nv 9 5 0\nv 0 5 0\nv 0 0 4\nv 9 0 4\nv 9 5 4\nv 0 5 4\n" + b"".join(
    b"f %d %d %d %d\n" % face
    for face in ((1, 4, 3, 2), (5, 6, 7, 8), (1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (4, 1, 5, 8))
)


def row(method: str, count: int, asset: str = "box.obj", **changes: Any) -> dict[str, Any]:
    common = {"asset": asset, "method": method, "count": count, "attack": "none", "strength": None, "status": "ok"}
    facts = {"sha256": "0" * 64, "seed": 7, "textured": False, "settings": {}, "metrics": {}, "seconds": {}}
    return common | facts | {"key": f"{method} {count} {asset}", "dataset": "folder", "kind": ""} | changes


def test_the_middle_number_of_marks_counts_that_both_methods_made() -> None:
    rows = [row(method, count) for method in BOTH for count in (4, 16, 32)]
    rows += [row("meshmark", 16, "only-ours.obj"), row("meshmark", 16, "fell.obj")]
    rows += [row("meshmark-flat", 16, "fell.obj", status="failed")]
    assert chosen_rows(rows, BOTH, None) == (16, {"box.obj": rows[1]})
    assert chosen_rows(rows, BOTH, 4)[0] == 4


@pytest.mark.parametrize(("methods", "count"), [(("meshmark", "li"), None), (BOTH, 5)])
def test_what_was_not_benchmarked_is_refused_and_what_was_is_named(methods: tuple[str, str], count: int | None) -> None:
    rows = [row(method, 4) for method in BOTH]
    with pytest.raises(MeshmarkError, match=r"No asset .* was marked") as error:
        chosen_rows(rows, methods, count)
    assert error.value.code is ErrorCode.INVALID_PARAMETERS
    assert "meshmark, meshmark-flat" in error.value.remedy


def test_a_folder_without_results_is_told(tmp_path: Path) -> None:
    with pytest.raises(MeshmarkError, match="holds no results"):
        read_results(tmp_path)
    (tmp_path / "results.json").write_text("{}")
    with pytest.raises(MeshmarkError, match="not what a benchmark writes"):
        read_results(tmp_path)


def test_from_a_benchmarks_results_to_a_page_and_its_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SIDE", 32)
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets" / "box.obj").write_bytes(BOX)
    rows = [row(method, 2, asset) for method in BOTH for asset in ("box.obj", "gone.obj")]
    write_results(rows, BenchmarkOptions(tmp_path / "assets", tmp_path))
    options, found = read_results(tmp_path)
    count, _ = chosen_rows(found, BOTH, None)
    [shown] = list(trials(options, found, BOTH, count, assets=5, seed=0))
    assert (shown.asset, sorted(shown.methods), shown.delivered) == ("box.obj", list(BOTH), True)
    assert len(shown.original) == len(shown.first) == len(shown.second) == LEVEL + 8
    assert len({shown.original, shown.first, shown.second}) == 3
    path, number = write_study([shown], tmp_path / "study.html", count)
    key = read_key(path)
    assert (number, path.name, list(key.trials)) == (1, "study.key.json", [shown.id])
    assert (key.trials[shown.id].first, key.trials[shown.id].second) == shown.methods
    assert key.study in (tmp_path / "study.html").read_text()


def page() -> str:
    pictures = (b"RIFF",) * 24
    return study_page("0" * 12, [Trial("a" * 12, "</script>cow.glb", True, False, ("li", "paper"), *(pictures,) * 3)])


def test_nothing_on_the_page_tells_which_method_or_asset_it_shows() -> None:
    content = re.search(r'<script type="application/json" id="content">(.*?)</script>', page(), re.S)
    assert content is not None
    assert json.loads(content[1])["trials"][0].keys() == {"id", "original", "first", "second"}
    assert not re.search(r"cow|\bli\b|paper|meshmark-flat", page())


def test_the_page_runs_its_own_script_and_loads_nothing() -> None:
    policy, script = (
        re.search(r'content="(default-src[^"]*)"', page()),
        re.search(r"<script>(.*?)</script>", page(), re.S),
    )
    assert policy is not None
    assert script is not None
    digest = base64.b64encode(hashlib.sha256(script[1].encode()).digest()).decode()
    assert f"sha256-{digest}" in policy[1].replace("&#x27;", "'")
    assert not re.search(r"https?://", page())
