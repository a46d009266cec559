import cv2
import numpy as np
import pytest

from core.artwork.artwork import Artwork
from core.artwork.combine import beside
from core.artwork.outline import text_artwork
from core.artwork.qr import qr_artwork
from core.artwork.qr_code import check_code
from core.choices import LogoPosition
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters


def read(mark: Artwork, pixels: int = 600, *, light: bool = False) -> str:
    """What OpenCV decodes from the rings of a mark, drawn black on white, or of its ``light`` ones, white on black."""
    ground, color = (0, 255) if light else (255, 0)
    picture = np.full((int(pixels * mark.aspect) + 40, pixels + 40), ground, np.uint8)
    centre = np.array([0.5, mark.aspect / 2])
    rings = (mark.light or ()) if light else mark.rings
    cv2.fillPoly(picture, [np.round((ring * [1, -1] + centre) * pixels + 20).astype(np.int32) for ring in rings], color)
    return cv2.QRCodeDetector().detectAndDecode(picture)[0]


@pytest.mark.parametrize("light", [False, True], ids=["dark", "light"])
@pytest.mark.parametrize("content", ["https://a.example", "https://shop.example/order/4711?" + "x" * 74])
def test_a_qr_code_is_decoded_from_its_rings(content: str, light: bool) -> None:
    assert read(qr_artwork(content), light=light) == content


@pytest.mark.parametrize("light", [False, True], ids=["dark", "light"])
@pytest.mark.parametrize("position", LogoPosition)
def test_a_qr_code_is_decoded_beside_a_text(position: LogoPosition, light: bool) -> None:
    mark = beside(qr_artwork("https://a.example"), text_artwork("Order\n4711"), position)
    assert read(mark, 1200, light=light) == "https://a.example"
    assert mark.lines == ("Order", "4711")
    assert mark.logo == "qr"


def test_a_text_too_long_to_be_read_is_refused() -> None:
    with pytest.raises(MeshmarkError, match="version 6") as caught:
        qr_artwork("https://a.example/" + "x" * 100)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS


def test_a_code_too_small_to_be_read_is_refused_with_the_least_size() -> None:
    with pytest.raises(MeshmarkError, match="35 modules") as caught:
        check_code(Parameters(qr="https://a.example", size=2.0))
    assert "`size` of 2.1 or more" in caught.value.remedy
    check_code(Parameters(qr="https://a.example", size=2.1))


@pytest.mark.parametrize("position", LogoPosition)
def test_a_mark_of_logo_and_text_is_one_wide_and_neither_overlaps_the_other(position: LogoPosition) -> None:
    logo, text = qr_artwork("https://a.example"), text_artwork("BRAND")
    mark = beside(logo, text, position)
    points = np.concatenate(mark.rings)
    assert np.ptp(points, axis=0) == pytest.approx([1, mark.aspect])
    assert len(mark.rings) == len(logo.rings) + len(text.rings)
    letters = np.concatenate(mark.rings[: len(text.rings)])
    code = np.concatenate(mark.rings[len(text.rings) :])
    axis = 0 if position is LogoPosition.LEFT else 1
    apart = letters[:, 0].min() - code[:, 0].max() if axis == 0 else code[:, 1].min() - letters[:, 1].max()
    line, finder = np.ptp(letters[:, 1]), logo.line_height * np.ptp(code[:, 1])
    assert apart == pytest.approx(0.4 * line)
    assert mark.line_height == pytest.approx(min(line, finder))
