import pytest

from core.asset.budgets import Budgets
from core.asset.formats import to_document
from core.asset.gate import admit
from core.asset.xml import parse_xml
from core.errors import ErrorCode, MeshmarkError
from tests.core.asset.samples import zipped
from tests.cost import cost

_ENTITIES = "".join(f'<!ENTITY l{level} "{f"&l{level - 1};" * 10}">' for level in range(1, 10))
LAUGHS = f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY l0 "lol">{_ENTITIES}]><model>&l9;</model>'.encode()
FETCH = b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY f SYSTEM "file:///etc/passwd">]><model>&f;</model>'
DEEP = b"<model>" + b"<a>" * 10**6


def _parse(data: bytes) -> list[str]:
    seen: list[str] = []
    parse_xml(data, "The model", Budgets(), lambda name, _attributes: seen.append(name))
    return seen


def _code(data: bytes) -> ErrorCode:
    with pytest.raises(MeshmarkError) as caught:
        _parse(data)
    return caught.value.code


def test_elements_are_named_without_their_namespace() -> None:
    assert _parse(b'<m:model xmlns:m="uri"><b/><m:c/></m:model>') == ["model", "b", "c"]


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (LAUGHS, ErrorCode.UNSUPPORTED_FEATURE),
        (FETCH, ErrorCode.UNSUPPORTED_FEATURE),
        (DEEP, ErrorCode.BUDGET_EXCEEDED),
        (b"<model><a></model>", ErrorCode.MALFORMED_FILE),
        (b"<model>\xff</model>", ErrorCode.MALFORMED_FILE),
        (b"<model>PK\x05\x06</model>", ErrorCode.MALFORMED_FILE),
        ("<model/>".encode("utf-16"), ErrorCode.MALFORMED_FILE),
        (b'<?xml version="1.0" encoding="cp037"?><model/>', ErrorCode.MALFORMED_FILE),
        (b'<?xml version="1.0" encoding="no such"?><model/>', ErrorCode.MALFORMED_FILE),
        (b"", ErrorCode.MALFORMED_FILE),
    ],
)
def test_hostile_or_broken_xml_is_refused_for_its_reason(data: bytes, code: ErrorCode) -> None:
    assert _code(data) is code


@pytest.mark.parametrize("xml", [LAUGHS, FETCH, DEEP], ids=["laughs", "fetch", "deep"])
@pytest.mark.parametrize("kind", ["3mf", "dae", "dae+zip"])
def test_hostile_xml_costs_neither_time_nor_memory_in_any_format(xml: bytes, kind: str) -> None:
    scene = xml.replace(b"model>", b"COLLADA>")
    data = {"3mf": zipped({"3D/3dmodel.model": xml}), "dae": scene, "dae+zip": zipped({"a.dae": scene})}[kind]
    with cost() as spent, pytest.raises(MeshmarkError):
        to_document(data, admit(data))
    assert spent.calls < 10_000
    assert spent.peak < 2**20 + 4 * len(xml)
