"""Docstrings begin with a verb or a noun of the field, not with a bare pronoun."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PACKAGES = ("core", "service", "worker")

# A docstring that begins with one of these names nothing: its reader has to read on to learn what the thing is.
BARE = {"what", "that", "who", "whoever", "whom", "whose", "which", "whatever", "how", "where", "whether"}

Documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def docstrings(source: str) -> Iterator[tuple[str, str]]:
    """The names of what a file defines, itself included, and their docstrings."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, Documented) and (text := ast.get_docstring(node)):
            yield getattr(node, "name", "module"), text


def first_word(text: str) -> str:
    return text.split()[0].strip(",.:;`'\"").lower()


def bare(source: str, published: frozenset[str] = frozenset()) -> list[str]:
    """The first lines of docstrings that begin with a bare pronoun; ``published`` ones are the API's texts."""
    return [
        f"{name}: {text.splitlines()[0]}"
        for name, text in docstrings(source)
        if first_word(text) in BARE and " ".join(text.split()) not in published
    ]


@pytest.fixture(scope="module")
def published() -> frozenset[str]:
    """All descriptions in the API's schema: some are docstrings of models, and change only with the API."""

    def descriptions(value: object) -> Iterator[str]:
        if isinstance(value, dict):
            if isinstance(text := value.get("description"), str):
                yield " ".join(text.split())
            value = list(value.values())
        if isinstance(value, list):
            for part in value:
                yield from descriptions(part)

    return frozenset(descriptions(yaml.safe_load((ROOT / "openapi.yaml").read_text())))


@pytest.mark.parametrize("package", PACKAGES)
def test_a_docstring_begins_with_a_word_of_the_field(package: str, published: frozenset[str]) -> None:
    paths = sorted((ROOT / package).rglob("*.py"))
    assert paths
    found = {str(path.relative_to(ROOT)): bare(path.read_text(), published) for path in paths}
    assert not {path: lines for path, lines in found.items() if lines}


@pytest.mark.parametrize(
    "docstring", ["What a mark is.", "Whether a mesh is closed.", "Where: the camera.", "`Which` of them."]
)
def test_a_bare_pronoun_is_found_wherever_it_stands(docstring: str) -> None:
    for source in (
        f'"""{docstring}"""',
        f'class Mark:\n    """{docstring}"""',
        f'async def read():\n    """{docstring}"""',
        f'class Mark:\n    def read(self):\n        """{docstring}"""',
    ):
        assert len(bare(source)) == 1
    assert not bare(f'"""{docstring}"""', frozenset([docstring]))


@pytest.mark.parametrize("docstring", ["Marks of an asset.", "Reads a file.", "(N,) whether a face is closed."])
def test_other_docstrings_pass(docstring: str) -> None:
    assert not bare(f'def read():\n    """{docstring}"""')
