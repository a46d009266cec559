import pytest

from core.budgets import Budgets
from core.errors import Code, ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.formats.xml import Handlers, Tally, parse_xml
from tests.core.formats.samples import zipped
from tests.cost import cost

_ENTITIES = "".join(f'<!ENTITY l{level} "{f"&l{level - 1};" * 10}">' for level in range(1, 10))
LAUGHS = f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY l0 "lol">{_ENTITIES}]><model>&l9;</model>'.encode()
FETCH = b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY f SYSTEM "file:///etc/passwd">]><model>&f;</model>'
DEEP = b"<model>" + b"<a>" * 10**6
MANY = b"<model>" + b"<a/>" * 3 * 10**6 + b"</model>"
WIDE = b"<model " + b" ".join(b'a%x=""' % number for number in range(200_000)) + b"/>"
LONG = b"<model><!--" + b"x" * 3 * 2**20 + b"--></model>"


def _parse(data: bytes, budgets: Budgets | None = None) -> list[str]:
    seen: list[str] = []
    parse_xml(data, "The model", budgets or Budgets(), Handlers(lambda name, _attributes: seen.append(name)))
    return seen


def _code(data: bytes) -> Code:
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
        (MANY, ErrorCode.BUDGET_EXCEEDED),
        (WIDE, ErrorCode.BUDGET_EXCEEDED),
        (LONG, ErrorCode.BUDGET_EXCEEDED),
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


@pytest.mark.parametrize(
    ("document", "budgets", "what"),
    [
        (b"<m><a/><a/></m>", Budgets(xml_elements=2), "3 XML elements; at most 2"),
        (b"<m><!--</a></a>--><a/><a/></m>", Budgets(xml_elements=2), "3 XML elements; at most 2"),
        (b'<m><a x="" y=""/><a x=""/></m>', Budgets(xml_attributes=2), "3 attributes of XML elements"),
        (b'<m><a x="" y=""/><a x="" y="" z=""/></m>', Budgets(element_attributes=2), "element of more than 2"),
    ],
)
def test_elements_and_attributes_are_counted(document: bytes, budgets: Budgets, what: str) -> None:
    with pytest.raises(MeshmarkError, match=what) as caught:
        _parse(document, budgets)
    assert caught.value.code is ErrorCode.BUDGET_EXCEEDED
    _parse(document)


def test_the_documents_of_one_file_share_a_budget_that_its_rows_do_not_count_in() -> None:
    tally, budgets, seen = Tally(), Budgets(xml_elements=3), list[str]()
    part = b"<m>" + b"<vertex/>" * 10 + b"</m>"
    for _ in range(3):
        parse_xml(part, "m", budgets, Handlers(lambda name, _: seen.append(name)), tally=tally, rows=("vertex",))
    assert len(seen) == 33
    with pytest.raises(MeshmarkError, match="4 XML elements"):
        parse_xml(b"<m/>", "The model", budgets, Handlers(lambda *_: None), tally=tally)


def test_blank_lines_and_escaped_letters_do_not_cost_a_call_each() -> None:
    pieces: list[str] = []
    text = b"\n" * 10**6 + b"&lt;" * 10**6
    parse_xml(b"<m>" + text + b"</m>", "m", Budgets(), Handlers(lambda *_: None, text=pieces.append))
    assert "".join(pieces) == "\n" * 10**6 + "<" * 10**6
    assert len(pieces) < 100


HOSTILE = {"laughs": LAUGHS, "fetch": FETCH, "deep": DEEP, "many": MANY, "wide": WIDE, "long": LONG}


@pytest.mark.parametrize("xml", HOSTILE.values(), ids=HOSTILE)
@pytest.mark.parametrize("kind", ["3mf", "dae", "dae+zip"])
def test_hostile_xml_costs_neither_time_nor_memory_in_any_format(xml: bytes, kind: str) -> None:
    scene = xml.replace(b"model>", b"COLLADA>")
    data = {"3mf": zipped({"3D/3dmodel.model": xml}), "dae": scene, "dae+zip": zipped({"a.dae": scene})}[kind]
    with cost() as spent, pytest.raises(MeshmarkError):
        document_of(admit(data))
    assert spent.calls < 10_000
    assert spent.peak < 2**20 + 4 * len(xml)
