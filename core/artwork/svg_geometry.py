"""Geometry of SVG: lengths, transforms, viewports, and the outlines of shapes and of their strokes.

A transform is a (2, 3) matrix that acts on columns.
"""

import math
import re
from collections.abc import Mapping
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import pathops
from fontTools.pens.recordingPen import RecordingPen
from fontTools.svgLib.path import parse_path

from core.arrays import Float
from core.artwork.rings import Segments
from core.artwork.svg_tree import LIMITS, SVG, refused, unsupported

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_LENGTH = re.compile(rf"({_NUMBER})\s*(px|pt|pc|mm|cm|in|%)?")
_TRANSFORM = re.compile(r"\s*,?\s*(matrix|translate|scale|rotate|skewX|skewY)\s*\(([^()]*)\)")
_PIXELS = {None: 1.0, "px": 1.0, "pt": 4 / 3, "pc": 16.0, "mm": 96 / 25.4, "cm": 96 / 2.54, "in": 96.0}
_ALIGNMENT = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
_LARGEST = 1e7  # of a number
IDENTITY: Float = np.eye(2, 3)


class Viewport(NamedTuple):
    """A viewport: its size, and the transform from the coordinates inside to those outside."""

    width: float
    height: float
    inside: tuple[float, float]  # size in the coordinates inside
    transform: Float


def numbers(value: str) -> list[float]:
    """Numbers separated by spaces or commas."""
    try:
        found = [float(part) for part in value.replace(",", " ").split()]
    except ValueError:
        refused(f"has the numbers {value[:40]!r}, which cannot be read")
    if any(not abs(number) <= _LARGEST for number in found):
        refused(f"has a number beyond {_LARGEST:,.0f}")
    return found


def length(value: str | None, of: float, default: float = 0.0) -> float:
    """A length in pixels; per cents are shares ``of`` a length."""
    if value is None:
        return default
    found = _LENGTH.fullmatch(value.strip())
    if not found:
        refused(f"has the length {value[:40]!r}, which cannot be read", "Give lengths as numbers or in px, mm or %.")
    number = float(found[1]) * (of / 100 if found[2] == "%" else _PIXELS[found[2]])
    if not abs(number) <= _LARGEST:
        refused(f"has a length beyond {_LARGEST:,.0f}")
    return number


def compose(outer: Float, inner: Float) -> Float:
    """The transform that applies ``inner`` first."""
    return np.column_stack([outer[:, :2] @ inner[:, :2], outer[:, :2] @ inner[:, 2] + outer[:, 2]])


def applied(transform: Float, segments: Segments) -> Segments:
    """Segments whose points are transformed."""
    (a, b, c), (d, e, f) = transform.tolist()
    return [(kind, tuple((a * x + b * y + c, d * x + e * y + f) for x, y in points)) for kind, points in segments]


def transform_of(value: str | None) -> Float:
    """The matrix of a ``transform`` attribute."""
    matrix, at = IDENTITY, 0
    text = (value or "").strip()
    while at < len(text):
        found = _TRANSFORM.match(text, at)
        arguments = numbers(found[2]) if found else []
        one = _matrix(found[1], arguments) if found else None
        if found is None or one is None:
            refused(f"has the transform {text[:60]!r}, which cannot be read")
        matrix, at = compose(matrix, one), found.end()
        if not (np.abs(matrix) <= _LARGEST).all():
            refused(f"is moved or enlarged by more than {_LARGEST:,.0f}")
    return matrix


def _matrix(name: str, values: list[float]) -> Float | None:
    match name, values:
        case "matrix", [a, b, c, d, e, f]:
            return np.array([[a, c, e], [b, d, f]])
        case "translate", [x, *rest] if len(rest) < 2:
            return np.array([[1, 0, x], [0, 1, rest[0] if rest else 0]])
        case "scale", [x, *rest] if len(rest) < 2:
            return np.array([[x, 0, 0], [0, rest[0] if rest else x, 0]])
        case "rotate", [angle, *center] if len(center) in (0, 2):
            turn, (x, y) = math.radians(angle), center or (0, 0)
            cos, sin = math.cos(turn), math.sin(turn)
            return np.array([[cos, -sin, x - cos * x + sin * y], [sin, cos, y - sin * x - cos * y]])
        case "skewX", [angle]:
            return np.array([[1, math.tan(math.radians(angle)), 0], [0, 1, 0]])
        case "skewY", [angle]:
            return np.array([[1, 0, 0], [math.tan(math.radians(angle)), 1, 0]])
    return None


def viewport(element: Element, outside: tuple[float, float] | None, size: Mapping[str, str]) -> Viewport:
    """The viewport that an ``svg`` or a ``symbol`` opens.

    Args:
        element: the ``svg`` or ``symbol``.
        outside: size of the viewport around it; None at the root.
        size: ``width`` and ``height`` that a `use` gives, before the element's own.
    """
    box = numbers(element.get("viewBox", ""))
    if box and (len(box) != 4 or min(box[2:]) <= 0):
        refused(f"has the viewBox {element.get('viewBox', '')[:40]!r}, which cannot be read")
    around = outside or (box[2:] and (box[2], box[3])) or (0.0, 0.0)
    asked = {name: size.get(name, element.get(name)) for name in ("width", "height")}
    if outside is None and box and (asked["width"] is None) != (asked["height"] is None):
        ratio = box[2] / box[3]  # the missing side follows from the other
        if asked["height"] is None:
            asked["height"] = str(length(asked["width"], around[0]) / ratio)
        else:
            asked["width"] = str(length(asked["height"], around[1]) * ratio)
    width, height = (
        length(None if asked[name] == "auto" else asked[name], of, default=of)
        for name, of in zip(("width", "height"), around, strict=True)
    )
    if width <= 0 or height <= 0:
        if outside is None:
            refused("has neither a viewBox nor a width and a height above 0", "Add a viewBox.")
        return Viewport(0, 0, (1, 1), IDENTITY)
    x, y = (
        (length(element.get(name), of) if outside and element.tag == SVG + "svg" else 0.0)
        for name, of in zip(("x", "y"), around, strict=True)
    )
    shift = np.array([[1.0, 0, x], [0, 1, y]])
    if not box:
        return Viewport(width, height, (width, height), shift)
    fit = _fitted(box, (width, height), element.get("preserveAspectRatio", ""))
    return Viewport(width, height, (box[2], box[3]), compose(shift, fit))


def _fitted(box: list[float], size: tuple[float, float], value: str) -> Float:
    """The transform that fits a view box into a viewport."""
    scale = np.array(size) / box[2:]
    words = value.split() or ["xMidYMid"]
    found = re.fullmatch(r"x(Min|Mid|Max)Y(Min|Mid|Max)", words[0])
    if words[0] == "none":
        share = np.zeros(2)
    elif found and words[1:] in ([], ["meet"], ["slice"]):
        scale = np.full(2, scale.max() if words[1:] == ["slice"] else scale.min())
        share = np.array([_ALIGNMENT[found[1]], _ALIGNMENT[found[2]]])
    else:
        refused(f"has the preserveAspectRatio {value[:40]!r}, which cannot be read")
    shift = share * (np.array(size) - scale * box[2:]) - scale * box[:2]
    return np.array([[scale[0], 0, shift[0]], [0, scale[1], shift[1]]])


def outline(element: Element, name: str, within: tuple[float, float]) -> Segments:
    """Outline of a shape, in its own coordinates.

    Args:
        element: the shape.
        name: of its element.
        within: size of its viewport, for per cents.
    """
    wide, high = within
    diagonal = math.hypot(wide, high) / math.sqrt(2)

    def size(key: str, of: float) -> float:
        return length(element.get(key), of)

    match name:
        case "path":
            return _drawn(element.get("d", ""))
        case "rect":
            return _rectangle(element, within)
        case "circle":
            radius = size("r", diagonal)
            return _ellipse(size("cx", wide), size("cy", high), radius, radius)
        case "ellipse":
            given = [None if element.get(key) in (None, "auto") else element.get(key) for key in ("rx", "ry")]
            radii = [length(value, of) for value, of in zip(given, within, strict=True)]
            if None in given:
                radii = [max(radii)] * 2
            return _ellipse(size("cx", wide), size("cy", high), *radii)
        case "line":
            start = size("x1", wide), size("y1", high)
            return [("moveTo", (start,)), ("lineTo", ((size("x2", wide), size("y2", high)),)), ("endPath", ())]
    values = numbers(element.get("points", ""))
    if len(values) % 2:
        refused(f"has a <{name}> of an odd number of coordinates")
    points = list(zip(values[::2], values[1::2], strict=True))
    if len(points) < 2:
        return []
    last: tuple[str, tuple[tuple[float, float], ...]] = ("closePath" if name == "polygon" else "endPath", ())
    return [("moveTo", (points[0],)), *(("lineTo", (point,)) for point in points[1:]), last]


# Errors of fontTools' parser on path data that is malformed: it checks nothing by itself.
_MALFORMED = (ValueError, IndexError, TypeError, AttributeError, NotImplementedError, ZeroDivisionError, AssertionError)


def _drawn(data: str) -> Segments:
    """Segments of path data."""
    pen = RecordingPen()
    try:
        parse_path(data, pen)
    except _MALFORMED:
        refused(f"has the path {data.strip()[:40]!r}, which cannot be read")
    for _, points in pen.value:
        for point in points:
            if not (abs(point[0]) <= _LARGEST and abs(point[1]) <= _LARGEST):
                refused(f"has a coordinate beyond {_LARGEST:,.0f}")
    return list(pen.value)


def _rectangle(element: Element, within: tuple[float, float]) -> Segments:
    x, y, width, height = (
        length(element.get(key), of) for key, of in zip(("x", "y", "width", "height"), within * 2, strict=True)
    )
    if width <= 0 or height <= 0:
        return []
    given = [None if element.get(key) in (None, "auto") else element.get(key) for key in ("rx", "ry")]
    radii = [length(value, of) for value, of in zip(given, within, strict=True)]
    if None in given:
        radii = [max(radii)] * 2
    rx, ry = min(max(radii[0], 0), width / 2), min(max(radii[1], 0), height / 2)
    if not rx or not ry:
        return _drawn(f"M{x} {y}h{width}v{height}h{-width}z")
    arc = f"a{rx} {ry} 0 0 1 "
    return _drawn(
        f"M{x + rx} {y}h{width - 2 * rx}{arc}{rx} {ry}v{height - 2 * ry}{arc}{-rx} {ry}"
        f"h{2 * rx - width}{arc}{-rx} {-ry}v{2 * ry - height}{arc}{rx} {-ry}z"
    )


def _ellipse(x: float, y: float, rx: float, ry: float) -> Segments:
    if rx <= 0 or ry <= 0:
        return []
    return _drawn(f"M{x + rx} {y}A{rx} {ry} 0 0 1 {x - rx} {y}A{rx} {ry} 0 0 1 {x + rx} {y}z")


def stroked(segments: Segments, style: Mapping[str, str], within: tuple[float, float], scale: float) -> Segments:
    """Outline of a stroke, to be filled by the non-zero rule.

    Args:
        segments: the line, in its own coordinates.
        style: the stroke's properties.
        within: size of the viewport, for per cents.
        scale: roughly how much the line is enlarged later; Skia's outlines are a quarter of a unit exact.

    Raises:
        MeshmarkError: ``invalid_logo`` for joins that are not drawn and for too many dashes.
    """
    diagonal = math.hypot(*within) / math.sqrt(2)
    width = length(style["stroke-width"], diagonal)
    if width < 0:
        refused(f"has the stroke-width {style['stroke-width'][:40]!r}, which cannot be read")
    if not width or not segments:
        return []
    try:
        cap = pathops.LineCap[f"{style['stroke-linecap'].upper()}_CAP"]
        join = pathops.LineJoin[f"{style['stroke-linejoin'].upper()}_JOIN"]
    except KeyError:
        unsupported(f"stroke-linecap={style['stroke-linecap']!r} with stroke-linejoin={style['stroke-linejoin']!r}")
    (miter, *_) = numbers(style["stroke-miterlimit"]) or [4.0]
    dashes = _dashes(segments, style, diagonal)
    path = pathops.Path()
    pen = path.getPen()
    for kind, points in applied(np.array([[scale, 0, 0], [0, scale, 0]]), segments):
        getattr(pen, kind)(*points)
    offset = length(style["stroke-dashoffset"], diagonal) % sum(dashes) if dashes else 0.0
    path.stroke(width * scale, cap, join, miter, [dash * scale for dash in dashes], offset * scale)
    path.convertConicsToQuads(0.05)
    back = 1 / scale
    names = {
        pathops.PathVerb.MOVE: "moveTo",
        pathops.PathVerb.LINE: "lineTo",
        pathops.PathVerb.QUAD: "qCurveTo",
        pathops.PathVerb.CUBIC: "curveTo",
        pathops.PathVerb.CLOSE: "closePath",
    }
    return applied(np.array([[back, 0, 0], [0, back, 0]]), [(names[verb], points) for verb, points in path])


def _dashes(segments: Segments, style: Mapping[str, str], diagonal: float) -> list[float]:
    """Lengths of dashes and gaps; none for a solid line."""
    value = style["stroke-dasharray"]
    if value == "none":
        return []
    dashes = [length(part, diagonal) for part in value.replace(",", " ").split()]
    if not dashes or min(dashes) < 0 or sum(dashes) == 0:
        return []
    dashes *= 1 + len(dashes) % 2
    reach, at = 0.0, (0.0, 0.0)
    for kind, points in segments:
        for point in points:
            reach += 0.0 if kind == "moveTo" else math.dist(at, point)
            at = point
    if reach / sum(dashes) * len(dashes) > 2 * LIMITS.dashes:
        refused(f"has a dashed line of more than {LIMITS.dashes:,} dashes", "Use fewer, or draw a solid line.")
    return dashes
