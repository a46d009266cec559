"""Records of tuned values say of each value what it means and where it comes from."""

import ast
import re
from pathlib import Path

import pytest

CORE = Path(__file__).parents[2] / "core"
RECORDS = {
    node.name: node
    for folder in ("placement", "analysis", "embossing", "artwork")
    for path in sorted((CORE / folder).glob("*.py"))
    for node in ast.parse(path.read_text()).body
    if isinstance(node, ast.ClassDef) and node.name.endswith("Options") and node.name != "PlacementOptions"
}


def test_each_algorithm_of_placement_has_its_record_in_the_record_of_all() -> None:
    (whole,) = (
        node
        for node in ast.parse((CORE / "placement" / "options.py").read_text()).body
        if isinstance(node, ast.ClassDef) and node.name == "PlacementOptions"
    )
    named = [ast.unparse(field.annotation) for field in whole.body if isinstance(field, ast.AnnAssign)]
    held = {name.removesuffix(" | None") for name in named}
    source = "".join(path.read_text() for path in sorted((CORE / "placement").glob("*.py")))
    defined = set(re.findall(r"^class (\w+Options|Objective)\b", source, re.MULTILINE))
    assert held == defined - {"PlacementOptions"}


@pytest.mark.parametrize("name", RECORDS)
def test_a_record_is_frozen_and_explains_each_of_its_values(name: str) -> None:
    record = RECORDS[name]
    assert [ast.unparse(decorator) for decorator in record.decorator_list] == ["dataclass(frozen=True)"]
    fields = [field for field in record.body if isinstance(field, ast.AnnAssign)]
    assert all(field.value is not None for field in fields)
    text = ast.get_docstring(record) or ""
    explained = re.findall(r"^    (\w+): ", text.partition("Attributes:")[2], re.MULTILINE)
    assert explained == [ast.unparse(field.target) for field in fields]


@pytest.mark.parametrize("name", [*RECORDS, "Objective"])
def test_a_record_says_which_values_are_the_papers(name: str) -> None:
    source = (CORE / "placement" / "objective.py").read_text()
    objective = next(n for n in ast.parse(source).body if isinstance(n, ast.ClassDef) and n.name == "Objective")
    text = ast.get_docstring(RECORDS.get(name, objective)) or ""
    assert re.search(r"\bours\b", text, re.IGNORECASE)
    assert re.search(r"\bpaper", text, re.IGNORECASE)
