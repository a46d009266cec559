"""SVG logos: what a designer sends is embossed as another renderer draws it, or refused by name."""

import io
import math

import numpy as np
import pytest
import resvg_py
from PIL import Image

from core.artwork.artwork import Artwork
from core.artwork.svg import LINE_SHARE, logo_artwork
from core.artwork.svg_tree import MAX_LOGO_BYTES
from core.errors import ErrorCode, MeshmarkError
from core.geometry.triangles import ring_area

HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 100 100" '
    'color="black">'
)
RECT = '<rect x="10" y="20" width="60" height="30"/>'
SHIELD = (
    "M20 13c0 5-3.500 7.500-7.660 8.950a1 1 0 0 1-.67-.01C7.500 20.500 4 18 4 13V6a1 1 0 0 1 1-1c2 0 4.500-1.200"
    " 6.240-2.720a1.170 1.170 0 0 1 1.520 0C14.510 3.810 17 5 19 5a1 1 0 0 1 1 1z"
)

# The cases that readers of SVG differ on, each with its holes.
CASES = {
    "a filled rectangle": (RECT, 0),
    "a path of curves": ('<path d="M10 50Q50 0 90 50T10 60C20 90 70 90 80 70S30 60 10 50z"/>', None),
    "the even-odd rule": ('<path fill-rule="evenodd" d="M10 10h80v80h-80zM30 30h40v40h-40z"/>', 1),
    "the non-zero rule, alike turned": ('<path d="M10 10h80v80h-80zM30 30h40v40h-40z"/>', 0),
    "the non-zero rule, against each other": ('<path d="M10 10h80v80h-80zM30 30v40h40v-40z"/>', 1),
    "a stroke": ('<circle cx="50" cy="50" r="30" fill="none" stroke="#123" stroke-width="8"/>', 1),
    "a stroke of joins and caps": (
        f'<path transform="scale(4)" fill="none" stroke="currentColor" stroke-width="2" stroke-linejoin="round" '
        f'stroke-linecap="round" d="{SHIELD}m-11-1 2 2 4-4"/>',
        None,
    ),
    "a dashed stroke": (
        '<path d="M10 50h80" fill="none" stroke="red" stroke-width="8" stroke-dasharray="10 4 2" '
        'stroke-dashoffset="3"/>',
        0,
    ),
    "currentColor": ('<g color="teal"><circle cx="40" cy="40" r="20" fill="currentColor"/></g>', 0),
    "transforms": (
        '<g transform="translate(50 50) rotate(30) skewX(10) scale(.5,.8)"><rect x="-40" y="-40" width="80" '
        'height="70" stroke="red" stroke-width="6" transform="matrix(1 .1 0 1 2 3)"/></g>',
        0,
    ),
    "a nested svg, which cuts off": (
        '<svg x="20" y="10" width="50" height="60" viewBox="0 0 10 10"><circle cx="5" cy="5" r="6"/></svg>',
        0,
    ),
    "a clip path": (
        '<clipPath id="c"><circle cx="50" cy="50" r="20"/><rect width="30" height="30"/></clipPath>'
        '<g clip-path="url(#c)"><rect x="10" y="10" width="40" height="70"/></g>',
        0,
    ),
    "a clip path of a clip path": (
        '<clipPath id="d"><rect width="50" height="100"/></clipPath><clipPath id="c" clip-path="url(#d)">'
        '<circle cx="50" cy="50" r="20"/></clipPath><rect clip-path="url(#c)" width="90" height="90"/>',
        0,
    ),
    "a style attribute": (
        '<rect style="fill:none;stroke:black;stroke-width:3px" x="10" y="10" width="40" height="70"/>',
        1,
    ),
    "a gradient": (
        '<defs><linearGradient id="a"><stop stop-color="red"/></linearGradient><linearGradient id="g" '
        'xlink:href="#a"/></defs><rect fill="url(#g)" x="10" y="10" width="40" height="70"/>',
        0,
    ),
    "display none": ('<g display="none"><circle r="50"/></g><g style="display:none"><circle r="50"/></g>' + RECT, 0),
    "visibility hidden": (
        '<g visibility="hidden"><circle r="50"/>' + RECT.replace("/>", ' visibility="visible"/></g>'),
        0,
    ),
    "opacity 0": ('<circle r="50" opacity="0"/><circle r="50" fill-opacity="0%"/>' + RECT, 0),
    "faint paint": ('<g opacity=".3">' + RECT.replace("/>", ' fill="blue" fill-opacity=".5"/></g>'), 0),
    "use by href": (
        '<defs><circle id="d" r="10"/></defs><use href="#d" x="30" y="40"/><use xlink:href="#d" x="70"/>',
        0,
    ),
    "use that inherits": (
        '<defs><path id="d" d="M0 0h20v20z"/></defs><use href="#d" x="30" y="30" fill="none" stroke="red"/>',
        1,
    ),
    "a symbol": (
        '<symbol id="d" viewBox="0 0 10 10"><circle cx="5" cy="5" r="6"/></symbol>'
        '<use href="#d" x="30" y="40" width="40" height="20"/>',
        0,
    ),
    "style sheet": (
        "<style>.a{fill:none;stroke:#000;stroke-width:4} #b.a{stroke-width:9} rect{stroke-width:20}</style>"
        '<rect id="b" class="a" x="20" y="20" width="40" height="60"/>',
        1,
    ),
    "style sheet in defs": (
        '<defs><style type="text/css"><![CDATA[.cls-1{fill:none;stroke:#000;stroke-width:4px}]]></style></defs>'
        '<rect class="cls-1" x="20" y="20" width="40" height="60"/>',
        1,
    ),
    "an important rule": (
        "<style>g rect{fill:none !important}</style><g><rect width='90' height='90' style='fill:red'/></g>" + RECT,
        0,
    ),
    "shapes beyond the edge": ('<circle r="50"/>', 0),
    "many thin bars": ("".join(f'<rect x="{5 + 1.117 * n}" y="9" height="80" width=".37"/>' for n in range(70)), 0),
    "shapes that abut": ("".join(f'<path d="M{7.13 * n} 9h7.130v80h-7.130z"/>' for n in range(10)), 0),
    "small dots": ("".join(f'<circle cx="{5 + 9.37 * n}" cy="{3 * n + 5}" r="1.3"/>' for n in range(10)), 0),
    "what drawing programs add": (
        '<!-- made by hand --><title>Logo</title><metadata><r:RDF xmlns:r="urn:r"><r:li/></r:RDF></metadata>'
        '<s:namedview xmlns:s="urn:s"><s:grid/></s:namedview>' + RECT,
        0,
    ),
}


def drawing(content: str) -> bytes:
    return f"{HEAD}{content}</svg>".encode()


def covered(content: str) -> float:
    """Share of the painted bounding box that resvg covers."""
    png = resvg_py.svg_to_bytes(drawing(content).decode(), width=800, skip_system_fonts=True)
    alpha = np.asarray(Image.open(io.BytesIO(png)).convert("RGBA"), dtype=np.float64)[..., 3]
    alpha /= alpha.max()
    reach = [np.flatnonzero(alpha.max(axis=axis) > 0.5) for axis in (0, 1)]
    return float(alpha.sum() / math.prod(np.ptp(at) + 1 for at in reach))


def holes(artwork: Artwork) -> int:
    return sum(ring_area(ring) < 0 for ring in artwork.rings)


def refusal(content: str | bytes) -> str:
    with pytest.raises(MeshmarkError) as caught:
        logo_artwork(content if isinstance(content, bytes) else drawing(content))
    assert caught.value.code is ErrorCode.INVALID_LOGO
    assert caught.value.remedy
    return caught.value.message


@pytest.mark.parametrize("case", CASES)
def test_a_logo_covers_what_another_renderer_covers(case: str) -> None:
    content, expected = CASES[case]
    artwork = logo_artwork(drawing(content))
    assert artwork.ink == pytest.approx(covered(content), rel=0.02)  # edges of the box are whole pixels
    if expected is not None:
        assert holes(artwork) == expected
    points = np.concatenate(artwork.rings)
    np.testing.assert_allclose(points.max(axis=0), [0.5, artwork.aspect / 2], atol=1e-9)
    np.testing.assert_allclose(points.min(axis=0), [-0.5, -artwork.aspect / 2], atol=1e-9)
    assert artwork.line_height == LINE_SHARE * artwork.aspect


def test_a_logo_stands_upright_and_is_not_mirrored() -> None:
    rings = logo_artwork(drawing('<path d="M10 10h20v60h40v20h-60z"/>')).rings  # an L
    (ring,) = rings
    low = ring[ring[:, 1] < ring[:, 1].min() + 0.01]
    assert np.ptp(low[:, 0]) == pytest.approx(1)
    assert ring[np.argmax(ring[:, 1]), 0] < 0


def test_white_on_dark_is_a_hole_and_white_on_nothing_is_nothing() -> None:
    eye = (
        '<rect width="100" height="100" fill="#fff"/><circle cx="50" cy="50" r="40" fill="navy"/>'
        '<circle cx="50" cy="50" r="30" fill="#fefefe"/><circle cx="50" cy="50" r="10" fill="red"/>'
    )
    artwork = logo_artwork(drawing(eye))
    assert (len(artwork.rings), holes(artwork)) == (3, 1)
    assert artwork.ink == pytest.approx(math.pi * (40**2 - 30**2 + 10**2) / 80**2, rel=0.01)


def test_a_logo_all_in_white_is_ink() -> None:
    assert logo_artwork(drawing('<circle cx="50" cy="50" r="40" fill="white"/>')).ink == pytest.approx(0.785, abs=0.01)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('<mask id="m"/>', "<mask>"),
        ('<pattern id="m"/>', "<pattern>"),
        ("<filter/>", "<filter>"),
        ('<image width="9" height="9"/>', "<image>"),
        ("<text>A</text>", "<text>"),
        ("<marker/>", "<marker>"),
        ("<foreignObject/>", "<foreignObject>"),
        ("<rect><animate/></rect>", "<animate>"),
        ("<switch/>", "<switch>"),
        ('<a href="http://a.b"/>', "<a>"),
        ('<rect vector-effect="non-scaling-stroke" width="9" height="9"/>', "vector-effect"),
        ('<style>rect{vector-effect:non-scaling-stroke}</style><rect width="9" height="9"/>', "vector-effect"),
        ('<rect style="mix-blend-mode:multiply"/>', "mix-blend-mode"),
        ('<rect filter="url(#a)"/>', "filter"),
        ('<rect mask="url(#a)"/>', "mask"),
        ('<path marker-end="url(#a)" d="M0 0h9v9"/>', "marker-end"),
        ("<style>@media print{rect{fill:red}}</style>", "@media"),
        ("<style>rect:hover{fill:red}</style>", "rect:hover"),
        ('<rect width="50" height="50" fill="#fff" opacity=".2"/>', "see-through white"),
        ('<rect width="50" height="50" fill="blurple"/>', "'blurple'"),
        ('<rect width="1em" height="50"/>', "'1em'"),
        ('<rect transform="turn(3)" width="9" height="50"/>', "'turn(3)'"),
        ('<use href="#nothing"/>', "'nothing'"),
        ('<rect clip-path="url(#nothing)" width="9" height="9"/>', "clip path"),
        ('<rect fill="url(#nothing)" width="9" height="9"/>', "gradient"),
    ],
)
def test_what_is_not_drawn_is_refused_by_name(content: str, said: str) -> None:
    assert said in refusal(content)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("<script>1</script>", "script"),
        ('<x:script xmlns:x="http://www.w3.org/1999/xhtml"/>', "script"),
        ('<rect onload="x()"/>', "onload"),
        ('<use href="http://a.b/c.svg#d"/>', "nothing outside"),
        ('<use xlink:href="file:///etc/passwd"/>', "nothing outside"),
        ('<rect fill="url(http://a.b)"/>', "nothing outside"),
        ('<rect style="fill:url(http://a.b)"/>', "nothing outside"),
        ("<style>@import 'http://a.b';</style>", "@import"),
        ("<style>rect{fill:url( 'http://a.b' )}</style>", "nothing outside"),
    ],
)
def test_scripts_and_references_to_elsewhere_are_refused(content: str, said: str) -> None:
    assert said in refusal(content)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "well-formed"),
        (b"<svg", "well-formed"),
        (b"\x89PNG\r\n", "well-formed"),
        (b"<svg/>", "namespace"),
        (b'<html xmlns="http://www.w3.org/1999/xhtml"/>', "namespace"),
        (b'<!DOCTYPE svg><svg xmlns="http://www.w3.org/2000/svg"/>', "document type"),
        (b'<!DOCTYPE x [<!ENTITY a "b">]><svg xmlns="http://www.w3.org/2000/svg">&a;</svg>', "document type"),
        (b'<?xml version="1.0" encoding="utf-16le"?><svg xmlns="http://www.w3.org/2000/svg"/>', "utf-16le"),
        (b'<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0h9v9z"/></svg>', "viewBox"),
        (b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 -1 2"/>', "viewBox"),
        (b" " * (MAX_LOGO_BYTES + 1), "bytes"),
    ],
)
def test_what_is_no_svg_is_refused(data: bytes, said: str) -> None:
    assert said in refusal(data)


def test_copies_of_copies_are_refused_before_they_are_drawn() -> None:
    groups = "".join(f'<g id="a{n}">' + f'<use href="#a{n - 1}"/>' * 10 + "</g>" for n in range(1, 10))
    assert "10,000 elements" in refusal(f'<circle id="a0" r="1"/>{groups}')


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('<g id="s"><use href="#s"/></g>', "64 deep"),
        ('<clipPath id="c" clip-path="url(#c)"><rect/></clipPath><rect clip-path="url(#c)"/>', "64 deep"),
        ("<g>" * 70 + "</g>" * 70, "64 deep"),
        ("<g/>" * 5_001, "5,000 elements"),
        (f'<path d="M0 0{"h1v1" * 26_000}"/>', "50,000 lines"),
        ('<path d="M0 0h100" stroke="red" stroke-dasharray=".001"/>', "5,000 dashes"),
        ("<style>" + "a{}" * 501 + "</style>", "500 style rules"),
        ('<path d="M0 0h1e99v9"/>', "beyond"),
        ('<circle transform="scale(1e6) scale(1e6)" r="1"/>', "more than"),
    ],
)
def test_bombs_are_refused(content: str, said: str) -> None:
    assert said in refusal(content)


@pytest.mark.parametrize(
    "content",
    ["", '<rect fill="none" width="9" height="9"/>', '<path d="M0 0h50"/>', '<rect width="0" height="9"/>', "<g/>"],
)
def test_a_drawing_without_a_filled_area_is_refused(content: str) -> None:
    assert "no filled area" in refusal(content)


def test_a_drawing_that_another_renderer_shows_otherwise_is_refused() -> None:
    # By the standard, a gradient by the bounding box paints nothing where this has no height.
    line = (
        '<linearGradient id="g"><stop/><stop offset="1"/></linearGradient>'
        f'<path d="M0 50h100" stroke="url(#g)" stroke-width="9"/>{RECT}'
    )
    assert "Another renderer" in refusal(line)


def test_the_same_file_gives_the_same_rings() -> None:
    one, other = (logo_artwork(drawing(CASES["a stroke of joins and caps"][0])) for _ in range(2))
    assert [ring.tobytes() for ring in one.rings] == [ring.tobytes() for ring in other.rings]
