"""The signs by which formats are recognised: the surer one decides, and of one certainty only one format has any."""

import pytest

from core.errors import ErrorCode, MeshmarkError
from core.formats.format import Format
from core.formats.registry import FORMATS
from core.formats.signs import Certainty, Sign
from core.formats.sniff import sniff
from tests.core.formats.samples import OBJ, SAMPLES, STL_ASCII, STL_BINARY

BARE = [name for name in SAMPLES if not name.endswith("+zip") and name != "3mf"]
SIGNS = [(each, sign) for each, spec in FORMATS.items() for sign in spec.sniff]


def _shown(data: bytes) -> list[tuple[Format, Sign]]:
    return [(each, sign) for each, sign in SIGNS if sign.shows(data)]


@pytest.mark.parametrize("name", BARE)
def test_of_one_certainty_only_one_format_shows_a_sign(name: str) -> None:
    shown = _shown(SAMPLES[name])
    for certainty in Certainty:
        assert len({each for each, sign in shown if sign.certainty is certainty}) <= 1
    surest = min(shown, key=lambda found: found[1].certainty)
    assert surest[0] is sniff(SAMPLES[name]) is Format(name.split("-")[0])


def test_a_text_stl_with_a_line_of_an_obj_is_an_stl() -> None:
    assert sniff(STL_ASCII + b"\nv 0 0 0\n") is Format.STL


def test_an_obj_with_a_control_character_is_no_binary_stl() -> None:
    data = OBJ + b"# \x01\n"
    assert {each for each, _ in _shown(data)} == {Format.OBJ, Format.STL}
    assert sniff(data) is Format.OBJ


@pytest.mark.parametrize("model", [STL_ASCII, OBJ, STL_BINARY])
def test_a_model_in_another_container_is_refused_as_that(model: bytes) -> None:
    tar = b"solid.stl".ljust(257, b"\0") + b"ustar".ljust(255, b"\0") + model
    with pytest.raises(MeshmarkError, match="a tar archive") as caught:
        sniff(tar)
    assert caught.value.code is ErrorCode.UNKNOWN_FORMAT
