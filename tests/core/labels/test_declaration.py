"""What a caller may declare."""

from typing import Any

import pytest
from pydantic import ValidationError

from core.labels.declaration import Aigc, Declaration


@pytest.mark.parametrize(
    "given",
    [
        {"creator": ""},
        {"creator": "two\nlines"},
        {"creator": "x" * 501},
        {"created": "yesterday"},
        {"created": "2026-13-01"},
        {"source_type": "photo"},
        {"aigc": {"label": "4"}},
        {"aigc": {"label": 1}},
        {"aigc": "text"},
        {"aigc": {"produce_id": "a\x00b"}},
        {"unknown": 1},
    ],
)
def test_what_cannot_be_written_is_refused(given: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Declaration.model_validate(given)


@pytest.mark.parametrize("when", ["2026-11-30", "2026-11-30T12:00:00Z", "2026-11-30T12:00:00.5+01:00"])
def test_times_stay_as_they_are_written(when: str) -> None:
    assert Declaration(created=when).given() == {"created": when}


def test_chinas_fields_have_the_names_of_the_standard() -> None:
    assert list(Aigc().named()) == [
        "Label",
        "ContentProducer",
        "ProduceID",
        "ReservedCode1",
        "ContentPropagator",
        "PropagateID",
        "ReservedCode2",
    ]
