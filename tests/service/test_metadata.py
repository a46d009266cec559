import json

import pytest

from core.errors import MeshmarkError
from service.metadata import parse_metadata, parse_pair


def test_metadata_is_taken_as_it_is() -> None:
    most = {f"{'k' * 38}{number:02}": "ä" * 256 for number in range(16)}
    assert parse_metadata(json.dumps(most)) == most
    assert parse_metadata('{"a.b-c_1": ""}') == {"a.b-c_1": ""}
    assert parse_metadata("{}") == {}


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "metadata"),
        ("[]", "metadata"),
        ("null", "metadata"),
        ('{"order": 1}', "order"),
        ('{"order": null}', "order"),
        ('{"order": {"a": "b"}}', "order"),
        ('{"order": "\\u0000"}', "order"),
        ('{"order": "\\ud800"}', "metadata"),
        ('{"order": "a\\nb"}', "order"),
        (json.dumps({"order": "x" * 257}), "order"),
        (json.dumps({"k" * 41: "x"}), "k" * 41),
        ('{"": "x"}', "match"),
        ('{"a:b": "x"}', "a:b"),
        ('{"a b": "x"}', "a b"),
        (json.dumps({str(number): "x" for number in range(17)}), "16"),
    ],
)
def test_what_is_no_metadata_is_refused_by_name(text: str, named: str) -> None:
    with pytest.raises(MeshmarkError, match="invalid_metadata") as refused:
        parse_metadata(text)
    assert named in refused.value.message


def test_a_pair_is_split_at_its_first_colon() -> None:
    assert parse_pair("order:4711") == ("order", "4711")
    assert parse_pair("url:http://here") == ("url", "http://here")
    assert parse_pair("order:") == ("order", "")


@pytest.mark.parametrize("text", ["", "order", ":4711", "a b:c", "order:" + "x" * 257, "order:\0"])
def test_what_is_no_pair_is_refused(text: str) -> None:
    with pytest.raises(MeshmarkError, match="invalid_metadata"):
        parse_pair(text)
