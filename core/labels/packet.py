"""XMP packets in JSON-LD, as KHR_xmp_json_ld has them in a glTF: one is made, or one that is there is added to."""

import json
from dataclasses import dataclass
from typing import Any

from core.errors import ErrorCode, MeshmarkError
from core.labels.declaration import PROPAGATOR, Aigc

Json = dict[str, Any]

EXTENSION = "KHR_xmp_json_ld"
NAMESPACES = {
    "dc": "http://purl.org/dc/elements/1.1/",
    "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "xmp": "http://ns.adobe.com/xap/1.0/",
    "Iptc4xmpExt": "http://iptc.org/std/Iptc4xmpExt/2008-02-29/",
    "TC260": "http://www.tc260.org.cn/ns/AIGC/1.0/",
}
AIGC = "AIGC"


@dataclass(frozen=True)
class Statement:
    """A property of a packet.

    Attributes:
        name: with the prefix that :data:`NAMESPACES` has for its namespace.
        value: a string.
        kind: "text" for a string as it is, "words" for one in the default language, "list" for a list of one.
    """

    name: str
    value: str
    kind: str = "text"


@dataclass(frozen=True)
class Written:
    """Outcome of :func:`state`.

    Attributes:
        packet: with the statements.
        kept: names of the properties that said something else before, and still do.
    """

    packet: Json
    kept: tuple[str, ...]


def packets(document: Json) -> list[Json]:
    """The packets of a glTF's JSON.

    Raises:
        MeshmarkError: ``malformed_file`` where they are not as the extension has them.
    """
    extension = _mapping(document, "extensions").get(EXTENSION, {})
    found = extension.get("packets", []) if isinstance(extension, dict) else None
    if not isinstance(found, list) or not all(isinstance(packet, dict) for packet in found):
        raise _malformed("its packets are not an array of objects")
    return found


def packet_of_asset(document: Json) -> int | None:
    """The number of the packet about the whole file, if there is one.

    Raises:
        MeshmarkError: as :func:`packets`, and where there is no such packet.
    """
    reference = _mapping(_mapping(document, "asset"), "extensions").get(EXTENSION)
    if reference is None:
        return None
    number = reference.get("packet") if isinstance(reference, dict) else None
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number < len(packets(document)):
        raise _malformed("`asset` refers to a packet that does not exist")
    return number


def state(packet: Json, statements: list[Statement]) -> Written:
    """A packet with the ``statements`` that it does not make yet; what it says stays as it is.

    Raises:
        MeshmarkError: ``malformed_file`` where its context is not one of prefixes and addresses.
    """
    context = packet.get("@context", {})
    if not isinstance(context, dict) or not all(isinstance(address, str) for address in context.values()):
        raise _malformed("the context of a packet does not map prefixes to addresses")
    context, result, kept = dict(context), {key: value for key, value in packet.items() if key != "@context"}, []
    for one in statements:
        prefix, _, local = one.name.partition(":")
        key = f"{_prefix(context, prefix)}:{local}"
        if key not in result:
            result[key] = _value(context, one)
        elif said(result[key]) != one.value:
            kept.append(one.name)
    return Written({"@context": context, "@id": "", **result}, tuple(kept))


def property_of(packet: Json, name: str) -> Any:
    """The value that a packet has of a property, named by the prefix of :data:`NAMESPACES`; None without one."""
    prefix, _, local = name.partition(":")
    context = packet.get("@context")
    known = context.items() if isinstance(context, dict) else ()
    keys = [f"{mine}:{local}" for mine, address in known if address == NAMESPACES[prefix]]
    return next((packet[key] for key in keys if key in packet), None)


def said(value: Any) -> str | None:
    """The text of a property's value: of a list the first, of alternatives the default; None where it has none."""
    if isinstance(value, dict):
        found = [value.get(key) for key in ("rdf:_1", "@value", "@list", "@set") if key in value]
        found += [value[key] for key in value if key.endswith(":_1") and key != "rdf:_1"]
        return said(found[0]) if found else None
    if isinstance(value, list):
        return said(value[0]) if value else None
    return value if isinstance(value, str) else None


def aigc_labels(document: Json) -> list[tuple[Json, str]]:
    """China's labels in a glTF's JSON, each as the object that holds it and its key there: properties of packets, and
    of the extras of ``asset``, whose name contains AIGC (GB 45438-2025, appendix E)."""
    extras = document.get("asset", {}).get("extras")
    holders = [*packets(document), *([extras] if isinstance(extras, dict) else [])]
    return [(holder, key) for holder in holders for key in holder if AIGC in key and key != "@context"]


def as_aigc(value: Any) -> dict[str, Any] | None:
    """The fields of China's label from its JSON text, or from an object; None where it is neither."""
    if isinstance(value, str):
        try:
            value = json.loads(value)
        except ValueError:
            return None
    return value if isinstance(value, dict) else None


def with_propagator(value: Any, aigc: Aigc) -> Any | None:
    """China's label with the propagator's fields that it leaves empty and ``aigc`` has; None where nothing changes, or
    where it cannot be read."""
    fields = as_aigc(value)
    if fields is None:
        return None
    named = aigc.named()
    added = {name: named[name] for name in PROPAGATOR if named[name] and not fields.get(name)}
    if not added:
        return None
    fields = {**fields, **added}
    return aigc_text(fields) if isinstance(value, str) else fields


def aigc_text(fields: dict[str, Any]) -> str:
    """China's label as JSON text."""
    return json.dumps(fields, ensure_ascii=False, separators=(",", ":"))


def _prefix(context: Json, wanted: str) -> str:
    """The prefix that a context has for a namespace of ours; where it has none, one is added that is free."""
    address = NAMESPACES[wanted]
    for prefix, known in context.items():
        if known == address:
            return str(prefix)
    free = next(name for name in (wanted, *(f"{wanted}{number}" for number in range(2, 99))) if name not in context)
    context[free] = address
    return free


def _value(context: Json, statement: Statement) -> Any:
    if statement.kind == "list":
        return {"@list": [statement.value]}
    if statement.kind == "words":
        rdf = _prefix(context, "rdf")
        return {"@type": f"{rdf}:Alt", f"{rdf}:_1": {"@language": "x-default", "@value": statement.value}}
    return statement.value


def _mapping(parent: Json, key: str) -> Json:
    found = parent.get(key, {})
    if not isinstance(found, dict):
        raise _malformed(f"`{key}` is not an object")
    return found


def _malformed(what: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.MALFORMED_FILE,
        f"The metadata of this file ({EXTENSION}) cannot be added to: {what}.",
        "Correct or remove that extension, or ask for no `label`.",
    )
