"""Optional parameters and form parts in an OpenAPI document: present or absent, never null.

FastAPI describes them as `anyOf` a type and null, as in JSON; a generated client would send the word.
"""

from typing import Any

FORM = "multipart/form-data"


def without_null(document: dict[str, Any]) -> None:
    """Remove null from the schemas of parameters and forms, and forbid other parts of forms."""
    schemas = document["components"]["schemas"]
    for path in document["paths"].values():
        for operation in path.values():
            for parameter in operation.get("parameters", ()):
                parameter["schema"] = _without_null(parameter["schema"])
            form = operation.get("requestBody", {}).get("content", {}).get(FORM)
            if form:
                body = schemas[form["schema"]["$ref"].rpartition("/")[2]]
                body["additionalProperties"] = False
                body["properties"] = {name: _without_null(schema) for name, schema in body["properties"].items()}


def _without_null(schema: dict[str, Any]) -> dict[str, Any]:
    kinds = [kind for kind in schema.get("anyOf", ()) if kind != {"type": "null"}]
    if len(kinds) != 1:
        return schema
    kind: dict[str, Any] = kinds[0]
    return kind | {key: value for key, value in schema.items() if key != "anyOf"}
