"""The report as a model: what it has, who may add to it, and how it is read."""

from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from core.metrics.measurement import HIGHER_IS_BETTER
from core.report import EvaluationReport, FileFacts, Metrics, Report, Section

FILE = {"sha256": "00", "bytes": 1, "format": "glb"}


def keys(model: type[BaseModel]) -> list[str]:
    """The fields of a model as its JSON has them."""
    return [field.alias or name for name, field in model.model_fields.items()]


def test_each_metric_has_its_field() -> None:
    quality, utility = (Metrics.model_fields[name].annotation for name in HIGHER_IS_BETTER)
    assert {"watermark_quality": keys(quality), "asset_utility": keys(utility)} == {  # type: ignore[arg-type]
        kind: [*names] for kind, names in HIGHER_IS_BETTER.items()
    }


def sections(model: type[BaseModel] = Section) -> list[type[BaseModel]]:
    return [each for below in model.__subclasses__() for each in (below, *sections(below))]


def test_each_field_is_described_by_itself_or_by_its_type() -> None:
    assert all(section.__doc__ for section in sections())
    for section in sections():
        for name, field in section.model_fields.items():
            assert field.description or field.annotation in sections(), (section.__name__, name)


def test_nobody_writes_a_field_that_the_report_does_not_have() -> None:
    with pytest.raises(ValidationError, match="author"):
        FileFacts.model_validate(FILE | {"author": "nobody"})


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_what_is_no_number_does_not_get_into_a_report(number: float) -> None:
    with pytest.raises(ValidationError, match="finite"):
        Metrics.model_validate({"seconds": {"shape": number}})


@pytest.mark.parametrize("model", [Report, EvaluationReport])
def test_whoever_reads_by_the_schema_takes_fields_that_are_added_later(model: type[BaseModel]) -> None:
    def closed(schema: Any) -> list[Any]:
        """What a schema says of objects that take no other keys."""
        if isinstance(schema, dict):
            own = [schema.get("title")] if schema.get("additionalProperties") is False else []
            return own + [found for value in schema.values() for found in closed(value)]
        return [found for value in schema for found in closed(value)] if isinstance(schema, list) else []

    sent = {
        "Parameters",
        "Declaration",
        "Aigc",
        "Box",
        "BoxRegion",
        "NodeRegion",
        "MaterialRegion",
        "PreviewModel",
    }  # by a client
    assert set(closed(model.model_json_schema(mode="serialization"))) <= sent
