"""XML read safely: one pass of expat, without document types, entities or deep nesting."""

from collections.abc import Callable
from xml.parsers import expat

from core.asset.budgets import Budgets
from core.asset.refusals import malformed
from core.errors import ErrorCode, MeshmarkError

Start = Callable[[str, dict[str, str]], None]

_ENCODINGS = ("utf-8", "utf8", "us-ascii", "iso-8859-1")
_PIECE = 2**20  # bytes parsed at a time, so that a handler can stop a long file


def check_xml(data: bytes, what: str) -> None:
    """Refuse a document type before anything parses the document; comments may not mention one either.

    Raises:
        MeshmarkError: ``unsupported_feature``.
    """
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise _document_type(what)


def _document_type(what: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.UNSUPPORTED_FEATURE,
        f"{what} declares a document type, which is not read: its entities can grow without end.",
        "Export the model again without a DOCTYPE.",
    )


def parse_xml(
    data: bytes,
    what: str,
    budgets: Budgets,
    start: Start,
    end: Callable[[str], None] | None = None,
    text: Callable[[str], None] | None = None,
) -> None:
    """Call ``start`` with the name and attributes of each element, ``end`` with its name, ``text`` with what is inside.

    Names are without their namespace; attributes keep their prefix only where they have a namespace
    ("uri name"). Nothing outside of ``data`` is ever opened.

    Args:
        data: the document.
        what: the document in errors, such as "The 3MF model".
        budgets: bounds the nesting.
        start: may raise.
        end: may raise.
        text: gets a text in one piece or several; may raise.

    Raises:
        MeshmarkError: ``malformed_file`` for what is not well-formed or not in UTF-8, ``unsupported_feature`` for
            document types and entities, ``budget_exceeded`` for elements nested too deeply.
    """
    parser = expat.ParserCreate(namespace_separator=" ")
    depth = 0

    def declare(_version: str, encoding: str | None, _standalone: int) -> None:
        if encoding is not None and encoding.lower() not in _ENCODINGS:
            raise malformed(f"{what} is in {encoding[:40]}, not in UTF-8.")

    def refuse(*_: object) -> None:
        raise _document_type(what)

    def open_element(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > budgets.xml_depth:
            raise MeshmarkError(
                ErrorCode.BUDGET_EXCEEDED,
                f"{what} nests its elements more than {budgets.xml_depth} deep, which is the most accepted.",
                "Flatten the hierarchy of the model, or send it as a GLB.",
            )
        start(name.rpartition(" ")[2], attributes)

    def close_element(name: str) -> None:
        nonlocal depth
        depth -= 1
        if end is not None:
            end(name.rpartition(" ")[2])

    parser.XmlDeclHandler = declare
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = open_element
    parser.EndElementHandler = close_element
    if text is not None:
        parser.CharacterDataHandler = text
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise malformed(f"{what} is in UTF-16, not in UTF-8.")
    try:
        for at in range(0, len(data), _PIECE):
            parser.Parse(data[at : at + _PIECE], False)
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        raise malformed(
            f"{what} is not well-formed XML: {expat.ErrorString(error.code)}, line {error.lineno:,}."
        ) from None
