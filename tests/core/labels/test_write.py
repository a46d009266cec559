"""Labels in the JSON of a glTF."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.errors import ErrorCode, MeshmarkError
from core.labels.declaration import Aigc, Declaration, SourceType
from core.labels.packet import NAMESPACES, aigc_labels, as_aigc, property_of, said
from core.labels.profiles import PROFILES, Label
from core.labels.write import write_label
from core.notices import NoticeCode

TC260 = NAMESPACES["TC260"]
WHOLE = Declaration(
    creator="Example Ltd",
    title="Chair",
    rights="(c) Example Ltd",
    identifier="urn:example:47",
    system="Forge",
    system_version="3.1",
    created="2026-11-30T12:00:00Z",
    modified="2026-11-30",
    aigc=Aigc(content_producer="Example Ltd", produce_id="47"),
)
NOTHING = Declaration()


def bare(**asset: Any) -> dict[str, Any]:
    return {"asset": {"version": "2.0", **asset}}


def marked(packet: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A file with a packet about all of it."""
    document = bare(extensions={"KHR_xmp_json_ld": {"packet": 0}}, **more)
    return document | {
        "extensionsUsed": ["KHR_xmp_json_ld"],
        "extensions": {"KHR_xmp_json_ld": {"packets": [packet]}},
    }


def packet_of(document: dict[str, Any]) -> dict[str, Any]:
    [packet] = document["extensions"]["KHR_xmp_json_ld"]["packets"]
    return dict(packet)


def aigc_of(document: dict[str, Any]) -> dict[str, Any]:
    [(holder, key)] = aigc_labels(document)
    fields = as_aigc(holder[key])
    assert fields is not None
    return fields


def codes(found: Any) -> list[str]:
    return [notice.code for notice in found.notices]


@pytest.mark.parametrize("label", list(Label))
def test_a_label_says_what_its_profile_asks_for(label: Label) -> None:
    found = write_label(bare(), label, PROFILES[label].words or "MINE", WHOLE)
    document, packet = found.json, packet_of(found.json)
    source = None if label is Label.CUSTOM else SourceType.TRAINED_ALGORITHMIC_MEDIA.uri
    assert said(property_of(packet, "Iptc4xmpExt:DigitalSourceType")) == source == found.source_type
    assert {name: said(property_of(packet, name)) for name in ("dc:creator", "dc:title", "dc:identifier")} == {
        "dc:creator": "Example Ltd",
        "dc:title": "Chair",
        "dc:identifier": "urn:example:47",
    }
    assert property_of(packet, "xmp:CreateDate") == "2026-11-30T12:00:00Z"
    assert property_of(packet, "Iptc4xmpExt:AISystemVersionUsed") == "3.1"
    assert document["asset"]["extensions"] == {"KHR_xmp_json_ld": {"packet": 0}}
    assert document["extensionsUsed"] == ["KHR_xmp_json_ld"]
    words = " ".join((PROFILES[label].words or "MINE").split())
    assert document["asset"]["copyright"] == f"(c) Example Ltd; {words}"
    assert document["asset"]["extras"]["label"] == words
    assert "extensionsRequired" not in document
    assert found.notices == ()


def test_every_prefix_of_a_packet_is_explained_and_lists_are_marked_as_such() -> None:
    packet = packet_of(write_label(bare(), Label.CHINA, "AI生成", WHOLE).json)
    prefixes = {key.split(":")[0] for key in packet if ":" in key}
    assert prefixes | {"rdf"} == set(packet["@context"])
    assert packet["@id"] == ""
    assert packet["dc:creator"] == {"@list": ["Example Ltd"]}
    assert packet["dc:title"]["@type"] == "rdf:Alt"
    assert not any(isinstance(value, list) for value in packet.values())


def test_chinas_label_has_its_seven_fields_as_text_and_makes_nothing_up() -> None:
    found = write_label(bare(), Label.CHINA, "AI生成", NOTHING)
    [(holder, key)] = aigc_labels(found.json)
    assert json.loads(holder[key]) == {
        "Label": "1",
        "ContentProducer": "",
        "ProduceID": "",
        "ReservedCode1": "",
        "ContentPropagator": "",
        "PropagateID": "",
        "ReservedCode2": "",
    }
    assert holder["@context"][key.split(":")[0]] == TC260
    assert found.aigc == "written"
    assert codes(found) == [NoticeCode.INCOMPLETE_LABEL]
    assert "aigc.content_producer, aigc.produce_id" in found.notices[0].message


def test_a_platform_fills_its_own_fields_into_a_producers_label() -> None:
    theirs = {"Label": "1", "ContentProducer": "Maker", "ProduceID": "9", "ContentPropagator": "", "Own": "x"}
    document = marked({"@context": {"t": TC260}, "t:AIGC": json.dumps(theirs)})
    ours = Declaration(aigc=Aigc(content_producer="Shop", content_propagator="Shop", propagate_id="4711"))
    found = write_label(document, Label.CHINA, "AI生成", ours)
    assert aigc_of(found.json) == theirs | {"ContentPropagator": "Shop", "PropagateID": "4711"}
    assert (found.aigc, codes(found)) == ("filled", [])
    again = write_label(found.json, Label.CHINA, "AI生成", Declaration(aigc=Aigc(content_propagator="Other")))
    assert aigc_of(again.json) == aigc_of(found.json)
    assert again.aigc == "kept"


def test_chinas_label_in_the_extras_is_the_one_label_of_a_file() -> None:
    found = write_label(bare(extras={"AIGC": {"Label": "1"}}), Label.CHINA, "AI生成", WHOLE)
    assert aigc_of(found.json) == {"Label": "1"}
    assert found.aigc == "kept"


@pytest.mark.parametrize(
    "document",
    [
        marked({"@context": {"TC260": TC260}, "TC260:AIGC": "no JSON"}),
        marked({"@context": {"TC260": TC260}, "TC260:AIGC": "[1]"}),
        marked({"@context": {"TC260": TC260}, "TC260:AIGC": '{"Label":"1"}'}, extras={"AIGC": '{"Label":"2"}'}),
    ],
)
def test_an_aigc_label_that_cannot_be_read_or_is_there_twice_stays_and_is_told_of(document: dict[str, Any]) -> None:
    before = [holder[key] for holder, key in aigc_labels(document)]
    found = write_label(document, Label.CHINA, "AI生成", WHOLE)
    assert [holder[key] for holder, key in aigc_labels(found.json)] == before
    assert found.aigc == "kept"
    assert NoticeCode.KEPT_LABEL in codes(found)


def test_what_a_file_says_of_itself_stays_and_contradictions_are_told_of() -> None:
    capture = SourceType.DIGITAL_CREATION.uri
    packet: dict[str, Any] = {
        "@context": {"iptc": NAMESPACES["Iptc4xmpExt"], "dc": "http://example.com/another/", "purl": NAMESPACES["dc"]},
        "@id": "urn:uuid:1",
        "iptc:DigitalSourceType": capture,
        "dc:own": "theirs",
        "purl:creator": {"@list": ["Someone", "Else"]},
        "purl:rights": {"@type": "rdf:Alt", "rdf:_1": {"@language": "en", "@value": "CC0"}},
    }
    document = marked(packet, copyright="CC0", extras={"author": "Someone", "mine": 1})
    unchanged = json.dumps(document)
    found = write_label(document, Label.EUROPE, "AI\nGENERATED", Declaration(creator="Us", title="Chair"))
    after = packet_of(found.json)
    assert {key: after[key] for key in packet if key != "@context"} == {k: packet[k] for k in packet if k != "@context"}
    assert after["@context"] == packet["@context"] | {"rdf": NAMESPACES["rdf"]}
    assert said(after["purl:title"]) == "Chair"
    assert found.source_type == capture
    assert found.kept == ("Iptc4xmpExt:DigitalSourceType", "dc:creator")
    assert codes(found) == [NoticeCode.KEPT_LABEL]
    assert found.json["asset"]["copyright"] == "CC0; AI GENERATED"
    assert found.json["asset"]["extras"]["author"] == "Someone"
    assert found.json["asset"]["extras"]["mine"] == 1
    assert json.dumps(document) == unchanged


def test_a_prefix_that_means_something_else_is_not_used() -> None:
    packet = {"@context": {"xmp": "http://example.com/", "xmp2": "http://example.org/"}, "xmp:CreateDate": "theirs"}
    after = packet_of(write_label(marked(packet), Label.CUSTOM, "MINE", Declaration(created="2026-01-01")).json)
    assert after["xmp:CreateDate"] == "theirs"
    assert after["xmp3:CreateDate"] == "2026-01-01"
    assert after["@context"]["xmp3"] == NAMESPACES["xmp"]


def test_packets_about_parts_stay_theirs() -> None:
    document = bare() | {
        "scenes": [{"extensions": {"KHR_xmp_json_ld": {"packet": 0}}}],
        "extensions": {"KHR_xmp_json_ld": {"packets": [{"@context": {}, "@id": "scene"}]}},
    }
    found = write_label(document, Label.CUSTOM, "MINE", NOTHING)
    assert found.packet == 1
    assert found.json["scenes"] == document["scenes"]
    assert found.json["extensions"]["KHR_xmp_json_ld"]["packets"][0] == {"@context": {}, "@id": "scene"}


def test_a_label_is_written_once() -> None:
    once = write_label(bare(copyright="me"), Label.CHINA, "AI生成", WHOLE)
    twice = write_label(once.json, Label.CHINA, "AI生成", WHOLE)
    assert twice.json == once.json
    assert twice.notices == ()


@pytest.mark.parametrize(
    "document",
    [
        bare(extensions={"KHR_xmp_json_ld": {"packet": 0}}),
        bare(extensions={"KHR_xmp_json_ld": {"packet": "a"}}),
        bare(extensions={"KHR_xmp_json_ld": 3}),
        bare(extensions=3),
        bare() | {"extensions": 3},
        bare() | {"extensions": {"KHR_xmp_json_ld": 3}},
        bare() | {"extensions": {"KHR_xmp_json_ld": {"packets": {}}}},
        bare() | {"extensions": {"KHR_xmp_json_ld": {"packets": [1]}}},
        marked({"@context": "http://example.com/context.jsonld"}),
        marked({"@context": [{}]}),
    ],
)
def test_metadata_that_contradicts_itself_is_refused(document: dict[str, Any]) -> None:
    with pytest.raises(MeshmarkError) as error:
        write_label(document, Label.CHINA, "AI生成", WHOLE)
    assert error.value.code is ErrorCode.MALFORMED_FILE


@pytest.mark.parametrize("odd", [3, [], "text", None])
def test_extras_and_a_copyright_that_are_no_objects_and_no_text_stay(odd: Any) -> None:
    found = write_label(bare(extras=odd, copyright=[odd]), Label.EUROPE, "AI", NOTHING)
    assert found.json["asset"]["extras"] == odd
    assert found.json["asset"]["copyright"] == [odd]


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
names = st.sampled_from(["dc:creator", "dc:rights", "xmp:CreateDate", "TC260:AIGC", "@id", "a:AIGC", "@context", "b"])
context = st.dictionaries(
    st.sampled_from([*NAMESPACES, "a"]), st.sampled_from([*NAMESPACES.values(), "http://example.com/"])
)


@given(st.dictionaries(names, values), context, st.sampled_from(list(Label)))
def test_nothing_that_a_packet_says_is_lost(packet: dict[str, Any], prefixes: dict[str, str], label: Label) -> None:
    packet["@context"] = prefixes
    found = write_label(marked(packet), label, "AI生成", WHOLE)
    after = packet_of(found.json)
    for key, value in packet.items():
        if key == "@context":
            assert {name: after[key][name] for name in value} == value
        elif "AIGC" in key and found.aigc == "filled":
            before, now = as_aigc(value), as_aigc(after[key])
            assert before is not None
            assert now is not None
            assert {name: now[name] for name in before if before[name]} == {k: v for k, v in before.items() if v}
        else:
            assert after[key] == value
    addresses = list(after["@context"].values())
    assert all(addresses.count(NAMESPACES[name]) >= 1 for name in ("dc", "xmp"))
    labels = aigc_labels(found.json)
    assert len(labels) == max(len(aigc_labels(marked(packet))), 1)
