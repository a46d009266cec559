import pytest

from core.languages import language_tag


@pytest.mark.parametrize(
    ("text", "tag"),
    [
        ("zh-Hans", "zh-Hans"),
        ("ZH-hant-tw", "zh-Hant-TW"),
        ("ja", "ja"),
        ("en-US", "en-US"),
        ("es-419", "es-419"),
        ("haw", "haw"),
        ("", None),
        ("-", None),
        ("qq", None),
        ("klingon", None),
        ("zh_Hans", None),
        ("zh-Hans-", None),
        ("en-US-x-private", None),
        ("e\u0301n", None),
        ("ja" + "-JP" * 5000, None),
    ],
)
def test_a_tag_is_known_or_refused(text: str, tag: str | None) -> None:
    assert language_tag(text) == tag
