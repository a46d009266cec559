"""XML read safely: one pass of expat, without document types, entities or deep nesting, within budgets."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from xml.parsers import expat

from core.budgets import Budgets, within
from core.errors import ErrorCode, MeshmarkError
from core.refusals import malformed

Start = Callable[[str, dict[str, str]], None]

_ENCODINGS = ("utf-8", "utf8", "us-ascii", "iso-8859-1")
_PIECE = 2**18  # bytes parsed at a time: the parser holds no more than these and one tag
_TEXT_PIECE = 2**16  # characters; expat by itself gives each line and each escaped letter in a call of its own


@dataclass(frozen=True)
class Handlers:
    """Called while a document is parsed: for the name and attributes of each element where it starts, for its name
    where it ends, and for the text inside, in one piece or several."""

    start: Start
    end: Callable[[str], None] | None = None
    text: Callable[[str], None] | None = None


@dataclass
class Tally:
    """Counts over the XML parts of one file so far."""

    elements: int = 0
    attributes: int = 0


def check_xml(data: bytes, what: str) -> None:
    """Refuse a document type before anything parses the document; comments may not mention one either.

    Raises:
        MeshmarkError: ``unsupported_feature``.
    """
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise _document_type(what)


def count_elements(data: bytes) -> int:
    """Upper bound of the number of elements in a document: ``<`` in comments counts as well."""
    return data.count(b"<") - sum(map(data.count, (b"</", b"<!", b"<?")))


def _document_type(what: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.UNSUPPORTED_FEATURE,
        f"{what} declares a document type, which is not read: its entities can grow without end.",
        "Export the model again without a DOCTYPE.",
    )


def _too_much(what: str, fault: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.BUDGET_EXCEEDED,
        f"{what} {fault}, which is the most accepted.",
        "Simplify the model in the program that made it, or send it as a GLB.",
    )


def parse_xml(
    data: bytes,
    what: str,
    budgets: Budgets,
    handlers: Handlers,
    *,
    tally: Tally | None = None,
    rows: Collection[str] = (),
) -> None:
    """Call ``handlers`` for the elements and texts of a document, in its order.

    Names are without their namespace; attributes keep their prefix only where they have a namespace
    ("uri name"). Nothing outside of ``data`` is ever opened.

    Args:
        data: the document.
        what: the document in errors, such as "The 3MF model".
        budgets: bounds the nesting, elements, attributes, and the length of a tag.
        handlers: may raise.
        tally: of the other documents of the same file, whose elements count too.
        rows: names of elements that the handlers count themselves.

    Raises:
        MeshmarkError: ``malformed_file`` for XML that is not well-formed or not in UTF-8, ``unsupported_feature`` for
            document types and entities, ``budget_exceeded``.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise malformed(f"{what} is in UTF-16, not in UTF-8.")
    counted = tally or Tally()
    if not rows:  # else they are by far the most
        within(counted.elements + count_elements(data), budgets.xml_elements, "XML elements")
    parser = expat.ParserCreate(namespace_separator=" ")
    depth = 0

    def declare(_version: str, encoding: str | None, _standalone: int) -> None:
        if encoding is not None and encoding.lower() not in _ENCODINGS:
            raise malformed(f"{what} is in {encoding[:40]}, not in UTF-8.")

    def refuse(*_: object) -> None:
        raise _document_type(what)

    def open_element(full_name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > budgets.xml_depth:
            raise _too_much(what, f"nests its elements more than {budgets.xml_depth} deep")
        if len(attributes) > budgets.element_attributes:
            raise _too_much(what, f"has an element of more than {budgets.element_attributes:,} attributes")
        name = full_name.rpartition(" ")[2]
        if name not in rows:
            counted.elements += 1
            counted.attributes += len(attributes)
            if counted.elements > budgets.xml_elements:
                within(counted.elements, budgets.xml_elements, "XML elements")
            if counted.attributes > budgets.xml_attributes:
                within(counted.attributes, budgets.xml_attributes, "attributes of XML elements")
        handlers.start(name, attributes)

    def close_element(name: str) -> None:
        nonlocal depth
        depth -= 1
        if handlers.end is not None:
            handlers.end(name.rpartition(" ")[2])

    parser.XmlDeclHandler = declare
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = open_element
    parser.EndElementHandler = close_element
    if handlers.text is not None:
        parser.buffer_text = True
        parser.buffer_size = _TEXT_PIECE
        parser.CharacterDataHandler = handlers.text
    read = 0  # up to the tag, comment or instruction that has not ended yet
    try:
        for at in range(0, len(data), _PIECE):
            parser.Parse(data[at : at + _PIECE], False)
            read = max(read, parser.CurrentByteIndex)
            if at - read > budgets.xml_tag_bytes:
                raise _too_much(what, f"has a tag or comment of more than {budgets.xml_tag_bytes:,} bytes")
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        raise malformed(
            f"{what} is not well-formed XML: {expat.ErrorString(error.code)}, line {error.lineno:,}."
        ) from None
