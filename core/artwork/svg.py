"""SVG logos to closed polygons: what is drawn is walked once, united in its painting order, and checked by a referee.

Ink is all that is painted, except near-white paint, which uncovers the ground: white on a dark shape is a hole in it,
white on nothing is nothing. Where nothing darker is painted, white is ink.
"""

import math
from dataclasses import dataclass, field, replace
from xml.etree.ElementTree import Element, tostring

import numpy as np
from manifold3d import CrossSection, FillRule, OpType

from core.arrays import Float
from core.artwork.artwork import Artwork
from core.artwork.referee import check_drawing
from core.artwork.rings import Segments, clear_rings, flatten, normalised
from core.artwork.svg_geometry import (
    Viewport,
    applied,
    compose,
    length,
    outline,
    stroked,
    transform_of,
    viewport,
)
from core.artwork.svg_style import (
    INHERITED,
    SEE_THROUGH,
    VISIBLE,
    Tone,
    fraction,
    in_tones,
    inherited,
    inline_styles,
    tone,
)
from core.artwork.svg_tree import LIMITS, SHAPES, SVG, elements, linked, parse_svg, reference, refused, unsupported

# A logo's details are about as large as letters of this share of its height, by which its legibility goes.
LINE_SHARE = 0.25

# Shares of the longer side of the drawing. Curves are flattened by the first, and by so much of their own size, for the
# referee; outlines that are embossed lie within the second of those.
CHORD = 5e-4
SIMPLIFIED = 4e-4

_EMPTY = CrossSection()


def logo_artwork(svg: bytes) -> Artwork:
    """Outlines of an SVG logo.

    Raises:
        MeshmarkError: ``invalid_logo`` for files that are no plain SVG, exceed the limits, draw nothing, or draw
            otherwise than another renderer does, by more than half a per cent of their area.
    """
    root = parse_svg(svg)
    inline_styles(root)
    ids = _ids(root)
    view = viewport(root, None, {})
    unit = max(view.width, view.height)
    if min(view.width, view.height) * 64 < unit:
        refused("is more than 64 times as long as wide")
    walk = _Walk(ids, unit)
    walk.root(root, view)
    all_ink = not any(item.tone is Tone.INK for item in walk.painted)
    region = _inked(walk.painted, all_ink=all_ink)
    if region.area() <= 1e-6:
        refused("has no filled area", "Send an SVG whose shapes have a fill or a stroke.")
    in_tones(root, ids, all_ink=all_ink)
    check_drawing(svg, tostring(root), region, (view.width, view.height))
    low_x, low_y, high_x, high_y = region.bounds()
    size = max(high_x - low_x, high_y - low_y)
    width = high_x - low_x
    scaled = region.simplify(SIMPLIFIED * size).translate((-low_x, -high_y)).scale((1 / width, -1 / width))
    rings = clear_rings(scaled)
    if not rings:
        refused("has no filled area that is wide enough to emboss")
    count = sum(map(len, rings))
    if count > LIMITS.points:
        refused(f"has outlines of {count:,} points; at most {LIMITS.points:,} can be embossed", "Simplify its paths.")
    centred, aspect, ink = normalised(rings)
    return Artwork("", centred, aspect, ink, LINE_SHARE * aspect, logo="svg")


def _ids(root: Element) -> dict[str, Element]:
    ids: dict[str, Element] = {}
    for element, _ in elements(root):
        name = element.get("id")
        if name in ids:
            refused(f"has two elements of the id {name[:40]!r}")
        if name is not None:
            ids[name] = element
    return ids


@dataclass(frozen=True)
class _Painted:
    """A painted region, in shares of the longer side of the drawing."""

    region: CrossSection
    tone: Tone


def _inked(painted: list[_Painted], *, all_ink: bool) -> CrossSection:
    """The ink that is left of all that is painted, in this order."""
    ink, run = _EMPTY, list[_Painted]()
    for item in [*painted, None]:  # runs of one role are united at once
        if run and (item is None or (item.tone is not run[0].tone and not all_ink)):
            united = CrossSection.batch_boolean([each.region for each in run], OpType.Add)
            ink = ink + united if all_ink or run[0].tone is Tone.INK else ink - united
            run = []
        run += [] if item is None else [item]
    return ink


@dataclass(frozen=True)
class _State:
    """Inherited by what is drawn in an element.

    Attributes:
        transform: to the coordinates of the drawing, y down, its longer side 1.
        style: inherited properties.
        opacity: of all groups around.
        clip: region that is shown; None for all.
        within: size of the viewport, for per cents.
        depth: of elements, each `use` counted as one.
    """

    transform: Float
    style: dict[str, str]
    opacity: float
    clip: CrossSection | None
    within: tuple[float, float]
    depth: int = 0


@dataclass
class _Walk:
    """A walk over a drawing: what it painted so far, and how much it may still visit."""

    ids: dict[str, Element]
    unit: float
    painted: list[_Painted] = field(default_factory=list)
    visits: int = 0
    segments: int = 0

    def root(self, root: Element, view: Viewport) -> None:
        """Draw a whole document."""
        scale = np.array([[1 / self.unit, 0, 0], [0, 1 / self.unit, 0]])
        state = _State(scale, dict(INHERITED), 1.0, None, (view.width, view.height))
        inside = self._entered(root, state)
        if inside is not None:
            self._in_viewport(root, view, inside)

    def _entered(self, element: Element, state: _State) -> _State | None:
        """The state in an element; None where nothing in it is shown."""
        self.visits += 1
        if self.visits > LIMITS.visits:
            refused(f"draws more than {LIMITS.visits:,} elements", "Use fewer copies of its parts.")
        if state.depth >= LIMITS.depth:
            refused(f"nests its elements more than {LIMITS.depth} deep", "Ungroup the drawing.")
        opacity = state.opacity * fraction(element.get("opacity", "1"))
        if element.get("display") == "none" or opacity < VISIBLE:
            return None
        transform = compose(state.transform, transform_of(element.get("transform")))
        inside = replace(
            state,
            transform=transform,
            style=inherited(state.style, element),
            opacity=opacity,
            depth=state.depth + 1,
        )
        clipped = self._clip_of(element, inside)
        return inside if clipped is None else replace(inside, clip=_both(state.clip, clipped))

    def draw(self, element: Element, state: _State) -> None:
        """Draw an element and all in it."""
        name = element.tag.removeprefix(SVG)
        if name not in (*SHAPES, "g", "use", "svg"):
            return  # defs, symbols, clip paths and gradients are drawn where they are referred to
        inside = self._entered(element, state)
        if inside is None:
            return
        if name in SHAPES:
            self._shape(element, name, inside)
        elif name == "svg":
            self._in_viewport(element, viewport(element, inside.within, {}), inside)
        elif name == "use":
            self._use(element, inside)
        else:
            for child in element:
                self.draw(child, inside)

    def _in_viewport(self, element: Element, view: Viewport, state: _State) -> None:
        """Draw the children of an ``svg`` or ``symbol`` in the viewport that it opens."""
        if not view.width or not view.height:
            return
        clip = state.clip
        if element.get("overflow", "hidden") not in ("visible", "auto") or state.depth == 1:
            x, y = (length(element.get(key), of) for key, of in zip(("x", "y"), state.within, strict=True))
            if state.depth == 1 or element.tag != SVG + "svg":
                x = y = 0.0
            corners = [(x, y), (x + view.width, y), (x + view.width, y + view.height), (x, y + view.height)]
            frame = [("moveTo", (corners[0],)), *(("lineTo", (corner,)) for corner in corners[1:]), ("closePath", ())]
            clip = _both(clip, self._filled(frame, state.transform, "nonzero"))
        inside = replace(state, transform=compose(state.transform, view.transform), clip=clip, within=view.inside)
        for child in element:
            self.draw(child, inside)

    def _use(self, element: Element, state: _State) -> None:
        target = self.ids.get(linked(element) or "")
        if target is None:
            refused(f"refers to {(linked(element) or '')[:40]!r} that it does not have")
        x, y = (length(element.get(key), of) for key, of in zip(("x", "y"), state.within, strict=True))
        moved = replace(state, transform=compose(state.transform, np.array([[1, 0, x], [0, 1, y]])))
        name = target.tag.removeprefix(SVG)
        if name not in ("symbol", "svg"):
            self.draw(target, moved)
            return
        inside = self._entered(target, moved)
        if inside is not None:
            size = {key: value for key in ("width", "height") if (value := element.get(key)) is not None}
            self._in_viewport(target, viewport(target, inside.within, size), inside)

    def _shape(self, element: Element, name: str, state: _State) -> None:
        if state.style["visibility"] != "visible":
            return
        segments = outline(element, name, state.within)
        for kind in ("fill", "stroke"):
            role, alpha = tone(state.style[kind], state.style["color"], self.ids)
            alpha *= state.opacity * fraction(state.style[f"{kind}-opacity"])
            if role is Tone.NONE or alpha < VISIBLE:
                continue
            if role is Tone.GROUND and alpha < SEE_THROUGH:
                unsupported("see-through white, which is neither ink nor ground")
            if kind == "fill":
                region = self._filled(segments, state.transform, state.style["fill-rule"])
            else:
                scale = 4096 * math.sqrt(abs(np.linalg.det(state.transform[:, :2])))
                if not scale:
                    continue
                line = stroked(segments, state.style, state.within, scale)
                region = self._filled(line, state.transform, "nonzero")
            shown = region if state.clip is None else region ^ state.clip
            if not shown.is_empty():
                self.painted.append(_Painted(shown, role))

    def _filled(self, segments: Segments, transform: Float, rule: str) -> CrossSection:
        """The region that an outline encloses, in the coordinates of the drawing."""
        if rule not in ("nonzero", "evenodd"):
            refused(f"has the fill rule {rule[:40]!r}, which cannot be read")
        self.segments += len(segments)
        if self.segments > LIMITS.segments:
            refused(f"draws more than {LIMITS.segments:,} lines and curves", "Simplify its paths.")
        contours = []
        for contour in _contours(applied(transform, segments)):
            points = np.array([point for _, points in contour for point in points])
            reach = np.ptp(points, axis=0).max()
            if reach > 1e-9:
                contours += flatten(contour, CHORD * min(float(reach), 1.0))
        if sum(map(len, contours)) > 4 * LIMITS.segments:
            refused(f"has curves that take more than {4 * LIMITS.segments:,} points", "Simplify its paths.")
        return CrossSection(contours, FillRule.EvenOdd if rule == "evenodd" else FillRule.NonZero)

    def _clip_of(self, element: Element, state: _State) -> CrossSection | None:
        """The region that the ``clip-path`` of an element shows; None where it has none."""
        value = element.get("clip-path", "none")
        if value == "none":
            return None
        clip = self.ids.get(reference(value) or "")
        if clip is None or clip.tag != SVG + "clipPath":
            refused(f"refers to a clip path {value[:40]!r} that it does not have")
        if clip.get("clipPathUnits", "userSpaceOnUse") != "userSpaceOnUse":
            unsupported("clipPathUnits='objectBoundingBox'")
        if state.depth >= LIMITS.depth:
            refused(f"nests its clip paths more than {LIMITS.depth} deep")
        inside = replace(
            state,
            transform=compose(state.transform, transform_of(clip.get("transform"))),
            style=inherited(dict(INHERITED), clip),
            clip=None,
            depth=state.depth + 1,
        )
        parts = [self._clip_part(child, inside) for child in clip]
        region = CrossSection.batch_boolean([part for part in parts if part is not None] or [_EMPTY], OpType.Add)
        outer = self._clip_of(clip, inside)
        return region if outer is None else region ^ outer

    def _clip_part(self, element: Element, state: _State) -> CrossSection | None:
        """The region of a shape of a clip path; None where it has none."""
        name = element.tag.removeprefix(SVG)
        if name == "g" or (name not in SHAPES and name != "use"):
            return None  # readers pass over groups there
        inside = self._entered(element, replace(state, opacity=1.0))
        if inside is None:
            return None
        if name == "use":
            target = self.ids.get(linked(element) or "")
            if target is None or target.tag.removeprefix(SVG) not in SHAPES:
                unsupported("<use> of anything but a shape in a <clipPath>")
            x, y = (length(element.get(key), of) for key, of in zip(("x", "y"), inside.within, strict=True))
            part = self._clip_part(
                target, replace(inside, transform=compose(inside.transform, np.array([[1, 0, x], [0, 1, y]])))
            )
            return part if part is None or inside.clip is None else part ^ inside.clip
        if inside.style["visibility"] != "visible":
            return None
        segments = outline(element, name, inside.within)
        region = self._filled(segments, inside.transform, inside.style["clip-rule"])
        return region if inside.clip is None else region ^ inside.clip


def _both(one: CrossSection | None, other: CrossSection) -> CrossSection:
    return other if one is None else one ^ other


def _contours(segments: Segments) -> list[Segments]:
    """The single contours of an outline, each closed, as filling does."""
    contours: list[list[tuple[str, tuple[tuple[float, float], ...]]]] = []
    for kind, points in segments:
        if kind == "moveTo":
            contours.append([])
        if points:
            contours[-1].append((kind, points))
    return [[*contour, ("closePath", ())] for contour in contours if len(contour) > 1]
