import pytest

from core.verify.texts import best, enough, fewest_letters, likeness


@pytest.mark.parametrize(
    ("text", "reading", "is_it"),
    [
        ("watermark", "watermark", True),
        ("watermark", "WATER MARK", True),
        ("watermark", "watermrk", True),
        ("watermark", "waterway", False),
        ("watermark", "", False),
        ("AI", "AI", True),
        ("AI", "A1", False),
        ("AI生成", "AI 生成", True),
        ("AI生成", "AI生", False),
        ("AI GENERATED", "GENERATED", True),
    ],
)
def test_a_text_may_be_misread_by_one_letter_in_four_and_a_short_one_by_none(
    text: str, reading: str, is_it: bool
) -> None:
    assert (likeness(text, reading) >= enough(text)) == is_it


def test_the_most_like_of_several_texts_counts() -> None:
    assert best(["ORDER-1", "ORDER-22"], "order-22") == (1.0, "ORDER-22")
    assert best([], "order-22") == (0.0, None)


def test_how_short_a_reading_may_be_is_told_by_the_shortest_line_that_a_text_is_set_in() -> None:
    assert fewest_letters(["watermark", "ORDER-4711 A1"]) == 2
    assert fewest_letters(["AI\nGENERATED"]) == 2
    assert fewest_letters([" "]) == fewest_letters([]) == 0
