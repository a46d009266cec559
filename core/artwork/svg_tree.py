"""SVG documents read safely: known elements only, nothing outside of the file, within budgets."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NoReturn
from xml.etree.ElementTree import Element
from xml.parsers import expat

from core.errors import ErrorCode, MeshmarkError

MAX_LOGO_BYTES = 2**20
SVG, XLINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}"
SHAPES = ("path", "rect", "circle", "ellipse", "line", "polyline", "polygon")
GRADIENTS = ("linearGradient", "radialGradient")
_CONTAINERS = ("svg", "g", "defs", "symbol", "use", "clipPath", "stop", "style")
_SILENT = ("title", "desc", "metadata")  # nothing in them is drawn
_LINKED = ("use", *GRADIENTS)
_REFERENCE = re.compile(r"url\(\s*(['\"]?)(.*?)\1\s*\)", re.IGNORECASE)
_ENCODINGS = ("utf-8", "utf8", "us-ascii")


@dataclass(frozen=True)
class SvgLimits:
    """The most that a logo may have; designers' files stay far below.

    Attributes:
        elements: in the file.
        depth: of elements in each other.
        rules: of its style sheets.
        visits: elements drawn, each once for every `use` of it.
        segments: of outlines drawn, lines and curves.
        dashes: of dashed lines.
        points: of the outlines to emboss.
    """

    elements: int = 5_000
    depth: int = 64
    rules: int = 500
    visits: int = 10_000
    segments: int = 50_000
    dashes: int = 5_000
    points: int = 20_000


LIMITS = SvgLimits()


def refused(fault: str, remedy: str = "Send another SVG of the logo, exported as plain filled paths.") -> NoReturn:
    """Raise ``invalid_logo``: "The logo" and the fault."""
    raise MeshmarkError(ErrorCode.INVALID_LOGO, f"The logo {fault}.", remedy)


def unsupported(name: str) -> NoReturn:
    """Raise ``invalid_logo`` for an element or property that is not drawn, by its name."""
    refused(
        f"uses {name[:80]}, which is not supported",
        "Turn it into plain filled paths in the drawing program (expand appearance, object to path) and export again.",
    )


def parse_svg(data: bytes) -> Element:
    """The document, its comments, descriptions and foreign elements left out.

    Raises:
        MeshmarkError: ``invalid_logo`` for what is no well-formed SVG, has a document type, entities, scripts, event
            handlers, external references or elements that are not drawn, or exceeds the limits.
    """
    if len(data) > MAX_LOGO_BYTES:
        refused(f"has {len(data):,} bytes; at most {MAX_LOGO_BYTES:,} are accepted", "Simplify its paths.")
    stack: list[Element] = []
    roots: list[Element] = []
    count = skipping = 0

    def declare(_version: str, encoding: str | None, _standalone: int) -> None:
        if encoding is not None and encoding.lower() not in _ENCODINGS:
            refused(f"is in {encoding[:40]}, not in UTF-8")

    def entity(*_: object) -> None:
        refused("declares a document type, which is not read: its entities can grow without end", "Remove the DOCTYPE.")

    def start(full_name: str, attributes: dict[str, str]) -> None:
        nonlocal count, skipping
        count += 1
        if count > LIMITS.elements:
            refused(f"has more than {LIMITS.elements:,} elements", "Simplify the drawing.")
        if len(stack) + skipping >= LIMITS.depth:
            refused(f"nests its elements more than {LIMITS.depth} deep", "Ungroup the drawing.")
        space, _, name = full_name.rpartition(" ")
        if name.lower() == "script":
            refused("has a script", "Remove it: an image needs none.")
        if skipping or (stack and (name in _SILENT or "{" + space + "}" != SVG)):
            skipping += 1
            return
        if not stack and (name != "svg" or "{" + space + "}" != SVG):
            refused("is no SVG: its outermost element is no `svg` of the namespace http://www.w3.org/2000/svg")
        if name not in SHAPES and name not in GRADIENTS and name not in _CONTAINERS:
            unsupported(f"<{name}>")
        element = Element(SVG + name, {_attribute(key): value for key, value in attributes.items()})
        _check_references(name, element)
        (stack[-1] if stack else roots).append(element)
        stack.append(element)

    def end(_name: str) -> None:
        nonlocal skipping
        if skipping:
            skipping -= 1
        else:
            stack.pop()

    def text(characters: str) -> None:
        if not skipping and stack and stack[-1].tag == SVG + "style":
            stack[-1].text = (stack[-1].text or "") + characters

    parser = expat.ParserCreate(namespace_separator=" ")
    parser.buffer_text = True
    parser.XmlDeclHandler = declare
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = entity
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, text
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        refused(f"is no well-formed XML: {expat.ErrorString(error.code)}, line {error.lineno:,}")
    return roots[0]


def elements(root: Element) -> Iterator[tuple[Element, str]]:
    """All elements of a document in its order, and their names without the namespace."""
    for element in root.iter():
        yield element, element.tag.removeprefix(SVG)


def reference(value: str) -> str | None:
    """The id in ``url(#id)``; None where there is no reference."""
    found = _REFERENCE.search(value)
    return found[2].strip().removeprefix("#") if found else None


def linked(element: Element) -> str | None:
    """The id that an element's ``href`` names."""
    value = element.get("href", element.get(XLINK + "href"))
    return None if value is None else value.strip().removeprefix("#")


def _attribute(name: str) -> str:
    space, _, local = name.rpartition(" ")
    return "{" + space + "}" + local if space else local


def _check_references(name: str, element: Element) -> None:
    """Refuse event handlers, and references to anything but elements of the same document."""
    for key, value in element.items():
        local = key.rpartition("}")[2].lower()
        if local.startswith("on"):
            refused(f"has the event handler {local[:40]}", "Remove it: an image needs none.")
        if local == "base":
            unsupported("xml:base")
        if local in ("href", "src") and (name not in _LINKED or not value.strip().startswith("#")):
            refused(
                f"refers to {value[:80]!r} in <{name}>: nothing outside of the file is opened", "Embed it as paths."
            )
        check_local(value)


def _outside(address: str) -> NoReturn:
    refused(f"refers to {address[:80]!r}: nothing outside of the file is opened", "Embed it as paths.")


def check_local(value: str) -> None:
    """Refuse a property that refers to something outside of the document."""
    if "url" not in value.lower():
        return
    for found in _REFERENCE.finditer(value):
        if not found[2].strip().startswith("#"):
            _outside(found[2])
    if "\\" in value or re.search(r"url(?!\s*\()|url\([^)]*$", value, re.IGNORECASE):
        refused(f"has the reference {value[:80]!r}, which cannot be read")
