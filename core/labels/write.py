"""A label written into a glTF: its XMP packet, and what viewers show without reading one."""

import json
from dataclasses import dataclass
from typing import Literal

from core.labels.declaration import Aigc, Declaration
from core.labels.packet import (
    EXTENSION,
    Json,
    Statement,
    aigc_labels,
    aigc_text,
    as_aigc,
    packet_of_asset,
    packets,
    property_of,
    said,
    state,
    with_propagator,
)
from core.labels.profiles import PROFILES, Label
from core.notices import Notice, NoticeCode

AigcOutcome = Literal["written", "filled", "kept"]

SEPARATOR = "; "

# The property of a packet that each field of a declaration is written to.
PROPERTIES = {
    "title": ("dc:title", "words"),
    "rights": ("dc:rights", "words"),
    "creator": ("dc:creator", "list"),
    "identifier": ("dc:identifier", "text"),
    "created": ("xmp:CreateDate", "text"),
    "modified": ("xmp:ModifyDate", "text"),
    "system": ("Iptc4xmpExt:AISystemUsed", "text"),
    "system_version": ("Iptc4xmpExt:AISystemVersionUsed", "text"),
}
RIGHTS, SOURCE_TYPE, AIGC_PROPERTY = "dc:rights", "Iptc4xmpExt:DigitalSourceType", "TC260:AIGC"


@dataclass(frozen=True)
class WrittenLabel:
    """A labelled file.

    Attributes:
        json: of the glTF.
        packet: the number of the packet about the whole file.
        source_type: address of the declared source type; None where none is declared.
        aigc: China's label was ``written``, or the one that the file had was ``filled`` in or ``kept``; None: no label.
        kept: properties that the file had before, and that say something else than was asked for.
        notices: what is missing, and what was kept.
    """

    json: Json
    packet: int
    source_type: str | None
    aigc: AigcOutcome | None
    kept: tuple[str, ...]
    notices: tuple[Notice, ...]


def write_label(document: Json, label: Label, words: str, declaration: Declaration) -> WrittenLabel:
    """A glTF's JSON with a label. Nothing that it says already is changed or dropped.

    The packet about the whole file gets what it does not state yet, and the words for its rights where nobody states
    any; ``asset.copyright`` gets the rights and the words behind what it says, and ``asset.extras`` the names that it
    does not have, by the keys that Sketchfab uses where there are some. A file has at most one of China's labels (GB
    45438-2025, 6.1 c): where there is one already, only the fields of the propagator that it leaves empty are filled.

    Args:
        document: stays as it is.
        label: whose profile is followed.
        words: of the marks; lines become one.
        declaration: of the caller.

    Raises:
        MeshmarkError: ``malformed_file`` where the file's own metadata is broken.
    """
    result: Json = json.loads(json.dumps(document))
    words, profile = " ".join(words.split()), PROFILES[label]
    aigc, unread = _fill_aigc(result, declaration.aigc or Aigc())
    number = packet_of_asset(result)
    before = {} if number is None else packets(result)[number]
    source, given = declaration.source_type or profile.source_type, declaration.given()
    statements = [Statement(SOURCE_TYPE, source.uri)] if source else []
    statements += [Statement(name, given[key], kind) for key, (name, kind) in PROPERTIES.items() if key in given]
    if aigc is None and (profile.aigc or declaration.aigc is not None):
        statements.append(Statement(AIGC_PROPERTY, aigc_text((declaration.aigc or Aigc()).named())))
        aigc = "written"
    if words and "rights" not in given and property_of(before, RIGHTS) is None:
        statements.append(Statement(RIGHTS, words, "words"))
    written = state(before, statements)
    number = _store(result, number, written.packet)
    _mirror(result["asset"], declaration, words, said(property_of(written.packet, SOURCE_TYPE)))
    missing = _missing(result, written.packet, label)
    return WrittenLabel(
        json=result,
        packet=number,
        source_type=said(property_of(written.packet, SOURCE_TYPE)),
        aigc=aigc,
        kept=written.kept,
        notices=tuple(_notices(label, missing, written.kept, unread)),
    )


def _fill_aigc(document: Json, aigc: Aigc) -> tuple[AigcOutcome | None, bool]:
    """Fate of the label of China's that a file has, and whether it is one that cannot be read, or one of several."""
    found = aigc_labels(document)
    if not found:
        return None, False
    if len(found) > 1 or as_aigc(found[0][0][found[0][1]]) is None:
        return "kept", True
    holder, key = found[0]
    filled = with_propagator(holder[key], aigc)
    if filled is None:
        return "kept", False
    holder[key] = filled
    return "filled", False


def _store(document: Json, number: int | None, packet: Json) -> int:
    """Put the packet about the whole file in its place."""
    all_packets = document.setdefault("extensions", {}).setdefault(EXTENSION, {}).setdefault("packets", [])
    if number is None:
        number = len(all_packets)
        all_packets.append(packet)
    else:
        all_packets[number] = packet
    asset = document["asset"]
    asset.setdefault("extensions", {})[EXTENSION] = {"packet": number}
    used = document.setdefault("extensionsUsed", [])
    if EXTENSION not in used:
        used.append(EXTENSION)
    return number


def _mirror(asset: Json, declaration: Declaration, words: str, source_type: str | None) -> None:
    """Repeat the essentials where tools that know no XMP look for them."""
    copyright_ = asset.get("copyright", "")
    if isinstance(copyright_, str):
        parts = [part for part in (declaration.rights, words) if part and part not in copyright_]
        if parts:
            asset["copyright"] = SEPARATOR.join(part for part in (copyright_, *parts) if part)
    extras = asset.get("extras", {})
    if isinstance(extras, dict):
        mirrored = {
            "author": declaration.creator,
            "title": declaration.title,
            "identifier": declaration.identifier,
            "label": words or None,
            "digitalSourceType": source_type,
        }
        extras |= {name: value for name, value in mirrored.items() if value and name not in extras}
        if extras:
            asset["extras"] = extras


def _missing(document: Json, packet: Json, label: Label) -> list[str]:
    """The fields that a label's rule asks for and the file does not have."""
    found = [as_aigc(holder[key]) for holder, key in aigc_labels(document)]
    chinese = found[0] or {} if found else {}
    missing = []
    for field in PROFILES[label].fields:
        scope, _, name = field.rpartition(".")
        value = chinese.get(Aigc.title(name)) if scope else property_of(packet, PROPERTIES[name][0])
        if not value:
            missing.append(field)
    return missing


def _notices(label: Label, missing: list[str], kept: tuple[str, ...], unread: bool) -> list[Notice]:
    notices = []
    if missing:
        notices.append(
            Notice(
                NoticeCode.INCOMPLETE_LABEL,
                f'The label "{label}" has no {", ".join(missing)}, which its rules ask for and only you know.',
                "Send them in `declaration`.",
            )
        )
    if kept:
        notices.append(
            Notice(
                NoticeCode.KEPT_LABEL,
                f"This file says something else than you about {', '.join(kept)}; what it said is still there.",
                "Correct the file's own metadata, or leave these out of `declaration`.",
            )
        )
    if unread:
        notices.append(
            Notice(
                NoticeCode.KEPT_LABEL,
                "This file has an AIGC label that is not JSON, or several; a file may hold one only, so that none was "
                "added, and nothing was filled in.",
                "Correct the file's own metadata, so that it has one label.",
            )
        )
    return notices
