"""Rules of some places for a label: the one table of them.

These are facts of November 2026 from the sources named with each, most of them secondary; none of this is legal advice.
No rule names three-dimensional models, so that each profile does for a model what its rule asks of pictures.
"""

import re
from dataclasses import dataclass
from enum import StrEnum

from core.labels.declaration import SourceType


class Label(StrEnum):
    """Profiles of labels, by the place whose rules they follow."""

    CHINA = "cn"
    EUROPE = "eu"
    CALIFORNIA = "us-ca"
    KOREA = "kr"
    INDIA = "in"
    CUSTOM = "custom"


@dataclass(frozen=True)
class LabelProfile:
    """One row of the table.

    Attributes:
        words: of the mark where the request has no text; empty where only the caller knows them.
        elements: groups of words of which a text must have one each, in capitals.
        height: share of the picture's shorter side that the letters should be high, at least; None where no rule is
            known.
        first_line: height of the first line's letters over that of the others.
        source_type: declared where the caller does not; None where nothing may be taken for granted.
        fields: of the declaration that the rule asks for; ``aigc.`` precedes those of China's label.
        aigc: China's label is in the file.
        source: of these facts, and the day from which on the rule holds.
    """

    words: str
    elements: tuple[tuple[str, ...], ...]
    height: float | None
    first_line: float
    source_type: SourceType | None
    fields: tuple[str, ...]
    aigc: bool
    source: str


_GENERATED = SourceType.TRAINED_ALGORITHMIC_MEDIA
_AI = ("AI", "ARTIFICIAL INTELLIGENCE")

PROFILES: dict[Label, LabelProfile] = {
    Label.CHINA: LabelProfile(
        words="AI生成",
        elements=(("AI", "人工智能"), ("生成", "合成")),
        height=0.05,
        first_line=1.0,
        source_type=_GENERATED,
        fields=("aigc.content_producer", "aigc.produce_id"),
        aigc=True,
        source="GB 45438-2025 and the labelling measures of the CAC, since 2025-09-01; the height is that for pictures",
    ),
    Label.EUROPE: LabelProfile(
        words="AI\nGENERATED",
        elements=(_AI,),
        height=None,
        first_line=1.6,
        source_type=_GENERATED,
        fields=(),
        aigc=False,
        source="AI Act, Article 50(2), since 2026-08-02 (older systems 2026-12-02), and the Code of Practice of "
        "2026-06-10, in which the capital AI is the main element; a least size was not found",
    ),
    Label.CALIFORNIA: LabelProfile(
        words="AI GENERATED",
        elements=(_AI,),
        height=None,
        first_line=1.0,
        source_type=_GENERATED,
        fields=("creator", "system", "system_version", "created", "identifier"),
        aigc=False,
        source="SB 942 and AB 853, since 2026-08-02: a disclosure that is seen, and one with provider, system, "
        "version, time and identifier",
    ),
    Label.KOREA: LabelProfile(
        words="AI 생성",
        elements=((*_AI, "인공지능"),),
        height=None,
        first_line=1.0,
        source_type=_GENERATED,
        fields=(),
        aigc=False,
        source="AI Basic Act, Article 31, since 2026-01-22, and the guidelines of 2026-01-27",
    ),
    Label.INDIA: LabelProfile(
        words="AI GENERATED",
        elements=(_AI,),
        height=None,
        first_line=1.0,
        source_type=_GENERATED,
        fields=("identifier",),
        aigc=False,
        source="G.S.R. 120(E), since 2026-02-20; the tenth of the area that its draft asked for was not kept",
    ),
    Label.CUSTOM: LabelProfile(
        words="",
        elements=(),
        height=None,
        first_line=1.0,
        source_type=None,
        fields=(),
        aigc=False,
        source="the caller",
    ),
}


def lacking(label: Label, text: str) -> list[str]:
    """The elements that a ``text`` lacks for a label, each as `"AI" or "..."`; letters of either case count."""
    missing = [group for group in PROFILES[label].elements if not any(_has(text.upper(), word) for word in group)]
    return [" or ".join(f'"{word}"' for word in group) for group in missing]


def _has(text: str, word: str) -> bool:
    # "REPAIR" does not say AI; scripts without spaces join it to what follows.
    return re.search(rf"(?<![A-Z]){re.escape(word)}(?![A-Z])" if word.isascii() else re.escape(word), text) is not None
