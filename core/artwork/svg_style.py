"""Styles of SVG elements: style sheets and style attributes become plain attributes, as every reader knows them."""

import re
from collections.abc import Iterable
from enum import Enum
from xml.etree.ElementTree import Element

import cssselect2
import tinycss2
import tinycss2.color4

from core.artwork.svg_tree import GRADIENTS, LIMITS, SVG, check_local, elements, linked, reference, refused, unsupported

WHITE = 240 / 255  # a colour with all of red, green and blue above is the ground
SEE_THROUGH = 0.5  # a ground colour below this opacity is neither ground nor ink
VISIBLE = 1 / 255  # opacity below which nothing is seen

INHERITED = {
    "fill": "black",
    "fill-rule": "nonzero",
    "fill-opacity": "1",
    "stroke": "none",
    "stroke-width": "1",
    "stroke-opacity": "1",
    "stroke-linecap": "butt",
    "stroke-linejoin": "miter",
    "stroke-miterlimit": "4",
    "stroke-dasharray": "none",
    "stroke-dashoffset": "0",
    "clip-rule": "nonzero",
    "color": "black",
    "visibility": "visible",
}
OWN = ("opacity", "display", "clip-path", "overflow", "stop-color", "stop-opacity")
# Properties that change what is drawn in ways that are not drawn here, unless they have their initial value.
_REFUSED = {
    "mask": ("none",),
    "filter": ("none",),
    "marker": ("none",),
    "marker-start": ("none",),
    "marker-mid": ("none",),
    "marker-end": ("none",),
    "vector-effect": ("none",),
    "mix-blend-mode": ("normal",),
    "paint-order": ("normal", "fill", "fill stroke", "fill stroke markers"),
    "transform-origin": ("0 0", "0px 0px"),
    "pathLength": (),
    "systemLanguage": (),
    "requiredFeatures": (),
    "requiredExtensions": (),
}
# Of a style sheet, not of an attribute: readers differ on these.
_REFUSED_IN_STYLE = ("transform", "d", "x", "y", "cx", "cy", "r", "rx", "ry", "all")
_SELECTOR = re.compile(r"[\w\-.#*>,\s\u0080-\uffff]*")


class Tone(Enum):
    """Role of a paint: it leaves ink, uncovers the ground, or is not seen."""

    INK = "black"
    GROUND = "white"
    NONE = "none"


def inline_styles(root: Element) -> None:
    """Turn style sheets and style attributes into attributes, by their specificity and order, and remove them.

    Raises:
        MeshmarkError: ``invalid_logo`` for at-rules, selectors beyond types, classes, ids and descendants, and
            properties that are not drawn.
    """
    matcher, rules = cssselect2.Matcher(), 0
    for element, name in elements(root):
        if name != "style":
            continue
        if element.get("type", "text/css") != "text/css" or element.get("media", "all") not in ("all", "screen"):
            unsupported("a style sheet that is not for all media")
        for rule in tinycss2.parse_stylesheet(element.text or "", skip_comments=True, skip_whitespace=True):
            if rule.type == "at-rule":
                unsupported(f"@{rule.at_keyword}")
            if rule.type == "error":
                refused(f"has a style sheet that cannot be read: {rule.message}")
            prelude = tinycss2.serialize(rule.prelude)
            if not _SELECTOR.fullmatch(prelude):
                unsupported(f"the selector {prelude.strip()!r}")
            rules += 1 + prelude.count(",")
            if rules > LIMITS.rules:
                refused(f"has more than {LIMITS.rules} style rules", "Simplify the drawing.")
            declarations = _declarations(rule.content)
            for selector in cssselect2.compile_selector_list(rule.prelude):
                matcher.add_selector(selector, declarations)
    for wrapper in cssselect2.ElementWrapper.from_xml_root(root).iter_subtree():
        element = wrapper.etree_element
        matched = [declarations for *_, declarations in sorted(matcher.match(wrapper), key=lambda match: match[:2])]
        matched.append(_declarations(tinycss2.parse_component_value_list(element.attrib.pop("style", ""))))
        for urgent in (False, True):
            for declarations in matched:
                element.attrib.update({name: value for name, value, important in declarations if important is urgent})
        element.attrib.pop("class", None)
        _check_properties(element)
    for parent in list(root.iter()):
        for child in [child for child in parent if child.tag == SVG + "style"]:
            parent.remove(child)


def _declarations(content: Iterable[object]) -> list[tuple[str, str, bool]]:
    """Names, values and urgency of the declarations in a block that matter for the drawing."""
    found = []
    for item in tinycss2.parse_blocks_contents(content, skip_comments=True, skip_whitespace=True):
        if item.type != "declaration":
            unsupported("a style that cannot be read")
        name, value = item.lower_name, tinycss2.serialize(item.value).strip()
        check_local(value)
        if name in _REFUSED_IN_STYLE:
            unsupported(f"the style {name!r}")
        if name in INHERITED or name in OWN or name in _REFUSED:
            found.append((name, value, item.important))
    return found


def _check_properties(element: Element) -> None:
    for name, initial in _REFUSED.items():
        value = element.get(name)
        if value is not None and " ".join(value.split()) not in initial:
            unsupported(f"{name}={value!r}")
    for name in OWN:
        if element.get(name) in ("inherit", "unset", "revert"):
            unsupported(f"{name}={element.get(name)!r}")


def inherited(style: dict[str, str], element: Element) -> dict[str, str]:
    """The inherited properties of an element, from those of its parent."""
    own = {name: value.strip() for name in INHERITED if (value := element.get(name)) is not None}
    return style | {name: value for name, value in own.items() if value != "inherit"}


def fraction(value: str) -> float:
    """An opacity, 0 to 1, of a number or a percentage."""
    value = value.strip()
    try:
        number = float(value[:-1]) / 100 if value.endswith("%") else float(value)
    except ValueError:
        refused(f"has the opacity {value[:40]!r}, which cannot be read")
    return min(max(number, 0.0), 1.0)


def tone(paint: str, color: str, ids: dict[str, Element]) -> tuple[Tone, float]:
    """Role and opacity of a paint.

    Args:
        paint: value of ``fill``, ``stroke`` or ``stop-color``.
        color: the property that ``currentColor`` stands for.
        ids: the elements of the document by their ids, for gradients.

    Raises:
        MeshmarkError: ``invalid_logo`` for a colour that cannot be read.
    """
    if paint == "none":
        return Tone.NONE, 0.0
    if (name := reference(paint)) is not None:
        return _gradient_tone(name, color, ids)
    found = tinycss2.color4.parse_color(color if paint.lower() == "currentcolor" else paint)
    if found is None or found == "currentcolor":
        refused(f"has the colour {paint[:40]!r}, which cannot be read")
    alpha = float(found.alpha)
    if alpha < VISIBLE:
        return Tone.NONE, 0.0
    light = all(channel >= WHITE for channel in found.to("srgb").coordinates)
    return (Tone.GROUND if light else Tone.INK), alpha


def _gradient_tone(name: str, color: str, ids: dict[str, Element]) -> tuple[Tone, float]:
    """Ink as soon as one stop of the gradient is; as opaque as its most opaque stop."""
    for _ in range(LIMITS.depth):
        gradient = ids.get(name)
        if gradient is None or gradient.tag.removeprefix(SVG) not in GRADIENTS:
            refused(f"refers to a gradient {name[:40]!r} that it does not have")
        stops = [child for child in gradient if child.tag == SVG + "stop"]
        following = linked(gradient)
        if stops or following is None:
            break
        name = following
    if not stops:
        refused(f"has a gradient {name[:40]!r} without stops")
    tones = []
    for stop in stops:
        found, alpha = tone(stop.get("stop-color", "black").strip(), stop.get("color", color), ids)
        tones.append((found, alpha * fraction(stop.get("stop-opacity", "1"))))
    seen = [each for each in tones if each[1] >= VISIBLE]
    opacity = max((alpha for _, alpha in seen), default=0.0)
    if not seen:
        return Tone.NONE, 0.0
    return (Tone.INK if any(found is Tone.INK for found, _ in seen) else Tone.GROUND), opacity


def in_tones(root: Element, ids: dict[str, Element], *, all_ink: bool) -> None:
    """Repaint a document in black ink on white ground: each paint by its role, all of it opaque.

    Args:
        root: the document, changed in place.
        ids: its elements by their ids.
        all_ink: draw ground colours as ink too, where there is nothing else.
    """
    repainted = []
    for element, _ in elements(root):
        new = {"color": "black"} if element.get("color", "inherit") != "inherit" else {}
        for name in ("fill", "stroke"):
            paint = element.get(name, "inherit").strip()
            if paint == "inherit":
                continue
            if paint.lower() == "currentcolor":
                new[name] = "currentColor"  # its role is that of the colour inherited
                continue
            role = tone(paint, "black", ids)[0]
            new[name] = Tone.INK.value if all_ink and role is Tone.GROUND else role.value
        if "color" in new and not all_ink:
            new["color"] = tone(element.attrib["color"].strip(), "black", ids)[0].value
            if new["color"] == Tone.NONE.value:
                unsupported("a transparent `color`")
        for name in ("fill-opacity", "stroke-opacity", "opacity"):
            if element.get(name, "inherit") != "inherit":
                new[name] = "1" if fraction(element.attrib[name]) >= VISIBLE else "0"
        repainted.append((element, new))
    for element, new in repainted:
        element.attrib.update(new)
