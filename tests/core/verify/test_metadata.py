"""Labels in the metadata of a suspect file."""

from typing import Any

import pytest

from core.errors import ErrorCode, MeshmarkError
from core.labels.declaration import Aigc, Declaration
from core.labels.packet import NAMESPACES
from core.labels.profiles import Label
from core.labels.write import write_label
from core.verify.metadata import read_label

BARE: dict[str, Any] = {"asset": {"version": "2.0"}}


def test_a_file_that_says_nothing_has_no_label() -> None:
    assert read_label(BARE) is None
    assert read_label({"asset": {"version": "2.0", "copyright": ["odd"]}}) is None


def test_what_was_written_is_read_back() -> None:
    declared = Declaration(creator="me", system="Forge", created="2026-11-30", aigc=Aigc(produce_id="47"))
    found = read_label(write_label(BARE, Label.CHINA, "AI生成", declared).json)
    assert found is not None
    assert (found.creator, found.system, found.created, found.rights) == ("me", "Forge", "2026-11-30", "AI生成")
    assert found.source_type is not None
    assert found.source_type.endswith("trainedAlgorithmicMedia")
    [aigc] = found.aigc
    assert aigc.fields is not None
    assert (aigc.fields["Label"], aigc.fields["ProduceID"]) == ("1", "47")
    assert found.copyright == "AI生成"


def test_labels_of_other_tools_are_read_under_their_own_prefixes() -> None:
    packet = {
        "@context": {"d": NAMESPACES["dc"], "r": NAMESPACES["rdf"], "t": NAMESPACES["TC260"]},
        "d:creator": {"@list": ["first", "second"]},
        "d:title": {"@type": "r:Alt", "r:_1": {"@language": "en", "@value": "Chair"}},
        "t:AIGC": "no JSON",
    }
    document = {
        "asset": {"version": "2.0", "extensions": {"KHR_xmp_json_ld": {"packet": 0}}},
        "extensions": {"KHR_xmp_json_ld": {"packets": [packet]}},
    }
    found = read_label(document)
    assert found is not None
    assert (found.creator, found.title) == ("first", "Chair")
    assert [(one.fields, one.text) for one in found.aigc] == [(None, "no JSON")]


def test_metadata_that_contradicts_itself_is_refused() -> None:
    with pytest.raises(MeshmarkError) as error:
        read_label({"asset": {"version": "2.0", "extensions": {"KHR_xmp_json_ld": {"packet": 4}}}})
    assert error.value.code is ErrorCode.MALFORMED_FILE
