"""Marks on surface without shading, and the contrast colours of their letters.

Letters without a colour of their own are visible by the shading of their sides alone. Unlit materials have none, and
bright emission outshines it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.analysis.color import Appearance, appearance
from core.arrays import Bool, Float
from core.geometry.boxes import Boxes
from core.geometry.faces_near import near
from core.geometry.products import length, product
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.gltf.colors import cielab, from_cielab, hex_linear, hex_srgb
from core.gltf.edit import Style
from core.gltf.scene import Scene
from core.notices import Notice, NoticeCode

SPECULAR = 0.04  # share of the light that a dielectric reflects without its base colour (glTF 2.0, appendix B.3.3)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # weights of linear sRGB (ITU-R BT.709)


@dataclass(frozen=True)
class ContrastOptions:
    """Values of :func:`looks_of_letters`: all ours; the paper gives letters no colour.

    Attributes:
        grid: points under each box and round it, along the text and across it.
        around: width and height of that grid over those of the box.
        dimmed: light on the dark side of a letter over that on the surface around it.
        shading: CIELAB lightness; least difference by ``dimmed`` light at which letters are legible.
        flat_share: share of the surface under a mark; with more than that unshaded a text is not legible as a whole.
        contrast: CIELAB lightness between letters and surface: about 7:1 in luminance on white.
        quantile: share of the surface under a mark whose lightness may be closer to the letters'.
        chroma: weight of a* and b* in the distance between letters and surface. On a painted statue auto colours are
            read with 0.71 at 1, 0.80 at 0.5, 0.58 at 0.2.
        faint: CIELAB units between letters and surface; below, recognition reads 0.37 to 0.69 of coloured marks on
            eleven textured assets, above 0.8 to 0.9. That was with chroma at its full weight, so that there is rather
            a notice too many than one too few.
    """

    grid: tuple[int, int] = (48, 16)
    around: tuple[float, float] = (1.04, 1.5)
    dimmed: float = 0.5
    shading: float = 5.0
    flat_share: float = 0.25
    contrast: float = 60.0
    quantile: float = 0.1
    chroma: float = 0.5
    faint: float = 30.0


CONTRAST = ContrastOptions()
CODES = ContrastOptions(chroma=0.0)  # readers of codes see light and dark


@dataclass(frozen=True)
class Look:
    """Colour of the letters of a mark, and how it shows.

    Attributes:
        style: their colour, if they have one.
        contrast: distance of that colour from what lies under and round them, CIELAB; None for the surface's own.
        lighter: whether it is lighter than what lies there.
    """

    style: Style
    contrast: float | None = None
    lighter: bool = False


OWN = Look(Style())  # the surface's own colour


def looks_of_letters(
    scene: Scene,
    surface: Surface,
    index: SpatialIndex,
    boxes: Boxes,
    palette: Sequence[str],
    options: ContrastOptions = CONTRAST,
) -> list[Look]:
    """The look of the letters of each of the ``boxes``.

    Letters have the colour of the palette that :func:`stands_out` best. Without one they have the surface's own where
    shading shows them. A mark counts as not shaded where a quarter of the surface in its box shows less than 5 units of
    lightness between full and half light: unlit materials, bright emission. Its letters are :func:`contrasting`.

    Args:
        scene: the asset.
        surface: the scene's, in which faces may be wound the other way round.
        index: over the faces that count; those near the boxes are looked at.
        boxes: of the marks.
        palette: the colours that letters may have, "#rrggbb"; of a single one only the emission is decided here.
        options: tuned values; those of codes are :data:`CODES`.

    Raises:
        MeshmarkError: as :func:`core.analysis.color.appearance`.
    """
    if not len(boxes) or not (palette or _outshines(scene)):
        return [OWN] * len(boxes)
    reach = options.around if palette else (1.0, 1.0)
    across = [
        share * ((np.arange(count) + 0.5) / count - 0.5) for count, share in zip(options.grid, reach, strict=True)
    ]
    plane = np.stack(np.meshgrid(*across, indexing="ij"), axis=-1).reshape(-1, 2)
    offset = np.einsum("pk,bk,bki->bpi", plane, boxes.size[:, :2], boxes.axes[:, :2])
    around = Boxes(boxes.center, boxes.axes, boxes.size * (*options.around, 2.0))
    local = index.among(np.unique(np.concatenate(near(surface, around))))
    _, face, point = local.closest((boxes.center[:, None] + offset).reshape(-1, 3))
    seen = appearance(scene, surface, point, face)
    shaped = (len(boxes), len(plane))
    needed = np.asarray(not_shaded(seen, options).reshape(shaped).mean(axis=1) >= options.flat_share)
    lab, unlit = cielab(seen.shown).reshape(*shaped, 3), np.all(seen.unlit.reshape(shaped), axis=1)
    looks = [OWN] * len(boxes)
    for box in range(len(boxes)) if palette else np.flatnonzero(needed).tolist():
        color, distance = stands_out(lab[box], palette or (contrasting(lab[box], options),), options)
        lighter = bool(cielab(hex_linear(color)[None])[0, 0] > np.median(lab[box, :, 0]))
        looks[box] = Look(Style(color, bool(needed[box] and lighter and not unlit[box])), distance, lighter)
    return looks


def _outshines(scene: Scene) -> bool:
    """True where any material of a scene is unlit or emits light: nothing else hides shading."""
    materials = {drawn.primitive.material for drawn in scene.primitives}
    return any(material.unlit or material.emission is not None for material in materials)


def stands_out(lab: Float, palette: Sequence[str], options: ContrastOptions = CONTRAST) -> tuple[str, float]:
    """The colour of the ``palette`` ("#rrggbb") that is farthest from all but a tenth of the CIELAB colours ``lab``
    (N, 3), and that distance, in which chroma has less weight; the first of equals."""
    colors = cielab(np.stack([hex_linear(color) for color in palette]))
    weight = np.array([1.0, options.chroma, options.chroma])
    apart = np.quantile(length((lab[:, None] - colors) * weight), options.quantile, axis=0)
    best = int(apart.argmax())
    return palette[best], float(apart[best])


def low_contrast(looks: Sequence[Look], options: ContrastOptions = CONTRAST) -> list[Notice]:
    """The notice that the colours of some marks hardly stand out from the surface there."""
    distances = [look.contrast for look in looks if look.contrast is not None]
    faint = sum(distance < options.faint for distance in distances)
    if not faint:
        return []
    return [
        Notice(
            NoticeCode.LOW_CONTRAST,
            f"The colour of {faint} of {len(looks)} marks hardly stands out from the surface there: the "
            f"least distance is {min(distances):.0f} (CIELAB), and from {options.faint:g} on letters are read well.",
            'Ask for another `color`, for several, or for "auto".',
        )
    ]


def unreadable_codes(looks: Sequence[Look]) -> list[Notice]:
    """The notice that QR codes have the surface's own colour: of such, of which only the walls show, OpenCV's decoder
    read none of eight in pictures."""
    plain = sum(look.style.color is None for look in looks)
    if not plain:
        return []
    return [
        Notice(
            NoticeCode.UNREADABLE_QR,
            f"{plain} of {len(looks)} QR codes have the surface's own colour: few readers will decode such codes.",
            'Ask for `color` "auto".',
        )
    ]


def not_shaded(seen: Appearance, options: ContrastOptions = CONTRAST) -> Bool:
    """(N,) points at which the incident light hardly changes the lightness."""
    lit = np.where(seen.unlit, 0, product(seen.lit, LUMINANCE[:, None])[:, 0] + SPECULAR)
    glow = product(seen.glow, LUMINANCE[:, None])[:, 0]
    full, dim = (_lightness(np.clip(glow + share * lit, 0, 1)) for share in (1, options.dimmed))
    return np.asarray(full - dim < options.shading)


def _lightness(luminance: Float) -> Float:
    """(N,) CIELAB lightness of luminances (N,), 0 to 1."""
    return np.asarray(cielab(np.repeat(luminance[:, None], 3, axis=1))[:, 0])


def contrasting(lab: Float, options: ContrastOptions = CONTRAST) -> str:
    """A colour, "#rrggbb", in contrast to a surface of the CIELAB colours ``lab`` (N, 3), and of its mean hue.

    Its lightness is the one farthest from that of all but a tenth of the surface, as near to it as ``contrast`` allows:
    darker or lighter than a surface of even lightness, black or white on a varied one, in between where half of it is
    dark and half is light.
    """
    levels = np.arange(101.0)
    apart = np.quantile(np.abs(levels[:, None] - lab[:, 0]), options.quantile, axis=1)
    enough = np.flatnonzero(apart >= min(apart.max(), options.contrast) - 1e-9)
    lightness = levels[enough[np.abs(enough - np.median(lab[:, 0])).argmin()]]
    hue = lab[:, 1:].mean(axis=0)
    # As much of the chroma as sRGB has at this lightness; black and white have none.
    shades = np.column_stack([np.full(101, lightness), np.linspace(1, 0, 101)[:, None] * hue])
    linear = from_cielab(shades)
    shown = linear[((linear >= -1e-6) & (linear <= 1 + 1e-6)).all(axis=1).argmax()]
    return hex_srgb(np.clip(shown, 0, 1))
