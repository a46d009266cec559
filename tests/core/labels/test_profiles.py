"""The table of rules."""

import pytest

from core.labels.declaration import Aigc, Declaration
from core.labels.profiles import PROFILES, Label, lacking


@pytest.mark.parametrize("label", list(Label))
def test_the_usual_words_of_a_label_say_what_its_rule_asks_for(label: Label) -> None:
    assert lacking(label, PROFILES[label].words) == []


@pytest.mark.parametrize(
    ("label", "text", "fits"),
    [
        (Label.CHINA, "人工智能合成", True),
        (Label.CHINA, "由AI生成", True),
        (Label.CHINA, "AI", False),
        (Label.CHINA, "生成", False),
        (Label.EUROPE, "Made by ai", True),
        (Label.EUROPE, "REPAIR", False),
        (Label.EUROPE, "AID", False),
        (Label.KOREA, "인공지능", True),
        (Label.CUSTOM, "anything", True),
    ],
)
def test_a_text_is_held_against_its_label(label: Label, text: str, fits: bool) -> None:
    assert (lacking(label, text) == []) == fits


@pytest.mark.parametrize("label", list(Label))
def test_what_a_rule_asks_for_can_be_declared(label: Label) -> None:
    known = set(Declaration.model_fields) | {f"aigc.{name}" for name in Aigc.model_fields}
    assert set(PROFILES[label].fields) <= known
