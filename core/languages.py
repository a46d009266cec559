"""Language tags (BCP 47)."""

import re

# ISO 639-1, and languages of living scripts and regions that have three letters only.
KNOWN = frozenset(
    re.findall(
        r"\w+",
        "aa ab ae af ak am an ar as av ay az ba be bg bi bm bn bo br bs ca ce ch co cr cs cu cv cy da de dv dz ee "
        "el en eo es et eu fa ff fi fj fo fr fy ga gd gl gn gu gv ha he hi ho hr ht hu hy hz ia id ie ig ii ik io "
        "is it iu ja jv ka kg ki kj kk kl km kn ko kr ks ku kv kw ky la lb lg li ln lo lt lu lv mg mh mi mk ml mn "
        "mr ms mt my na nb nd ne ng nl nn no nr nv ny oc oj om or os pa pi pl ps pt qu rm rn ro ru rw sa sc sd se "
        "sg si sk sl sm sn so sq sr ss st su sv sw ta te tg th ti tk tl tn to tr ts tt tw ty ug uk ur uz ve vi vo "
        "wa wo xh yi yo za zh zu ace ban bho brx bug ccp ceb chr ckb cop doi dsb fil fuf gsw haw hmn hsb jam kab "
        "khb kok ksw lis lrc lus mai mni mnw mus mzn nan nds new nod nqo osa rhg sat scn shi shn shr sma smj smn "
        "sms syr szl tdd tet tzm vai wae wuu yue zgh",
    )
)
_TAG = re.compile(r"([a-z]{2,3})(?:-([A-Z][a-z]{3}))?(?:-([A-Z]{2}|\d{3}))?")
LONGEST = 11


def language_tag(text: str) -> str | None:
    """A tag of language, script and region in its usual case; None where it is not one, or its language is unknown."""
    primary, *rest = text[: LONGEST + 1].split("-")
    cased = [part.title() if len(part) == 4 else part.upper() for part in rest]
    tag = "-".join([primary.lower(), *cased])
    return tag if _TAG.fullmatch(tag) and primary.lower() in KNOWN else None
