"""Corrections to the OpenAPI document that FastAPI writes, for linters and generators of clients."""

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

NOT_OF_HEAD = ("206", "307", "416")  # answers to GET alone: HEAD takes no range, and is not led elsewhere


def components(model: type[BaseModel]) -> dict[str, Any]:
    """The schemas of a model and of all that it consists of, by name."""
    _, described = models_json_schema([(model, "serialization")], ref_template="#/components/schemas/{model}")
    return dict(described["$defs"])


def restore_examples(document: dict[str, Any], *models: type[BaseModel]) -> None:
    """Put the examples of models, and of all that they consist of, in the document with their nulls, which FastAPI
    leaves out."""
    for model in models:
        for name, schema in components(model).items():
            if "examples" in schema:
                document["components"]["schemas"][name]["examples"] = schema["examples"]


def describe_head(document: dict[str, Any]) -> None:
    """Take the answers that only GET gives from the operations HEAD: any content, parts of it, and redirects."""
    for method, operation in _operations(document):
        if method == "head":
            for code in NOT_OF_HEAD:
                operation["responses"].pop(code, None)
            for response in operation["responses"].values():
                response.pop("content", None)


def describe_files(document: dict[str, Any]) -> None:
    """Say of the files in forms that they are bytes, in the words of OpenAPI 3.0 too: generated clients would send
    text."""
    for name, schema in document["components"]["schemas"].items():
        if name.startswith("Body_"):
            for part in schema["properties"].values():
                if part.get("contentMediaType") == "application/octet-stream":
                    part["format"] = "binary"


def without_foreign_refusals(document: dict[str, Any]) -> None:
    """Remove FastAPI's own shape of a refusal, which is never sent."""
    for name in ("HTTPValidationError", "ValidationError"):
        document["components"]["schemas"].pop(name, None)
    for _, operation in _operations(document):
        if "HTTPValidationError" in str(operation["responses"].get("422")):
            del operation["responses"]["422"]


def _operations(document: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for path in document["paths"].values():
        yield from path.items()
