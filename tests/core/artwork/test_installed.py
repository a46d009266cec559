import shutil
from pathlib import Path

import pytest

from core.artwork.installed import SYSTEM, faces_for, general_faces, packages_for
from core.artwork.layout import set_text
from core.artwork.outline import text_artwork
from core.errors import MeshmarkError
from tests.core.artwork.fontsmith import SQUARE, box, make_font

PRIVATE = "\ue000"  # no font has it


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of fonts that MESHMARK_FONTS names."""
    monkeypatch.setenv("MESHMARK_FONTS", str(tmp_path))
    return tmp_path


def names(text: str) -> list[str]:
    return [face.name for face in set_text(text).faces]


def test_the_packages_that_set_up_installs_are_here() -> None:
    assert not packages_for("Thai"), "install fonts-noto-core, as `make test` does"
    assert "fonts-noto-cjk" not in packages_for("Hani"), "install fonts-noto-cjk, as `make test` does"


def test_fonts_in_a_folder_of_ones_own_go_before_the_systems(own: Path) -> None:
    (own / "NotoSansThai-Bold.ttf").write_bytes(make_font({"\u0e01": [SQUARE]}))
    assert names("\u0e01") == ["Test"]


def test_any_font_in_that_folder_serves_what_no_other_has(own: Path) -> None:
    (own / "below").mkdir()
    (own / "below" / "Brand.otf").write_bytes(make_font({PRIVATE: [SQUARE], "a": [SQUARE]}, cff=True))
    assert names(f"b{PRIVATE}") == ["DejaVu Sans Bold", "Test"]


def test_of_a_family_the_bold_face_is_taken(own: Path) -> None:
    (own / "NotoSansThai-Regular.ttf").write_bytes(make_font({"\u0e01": [SQUARE]}))
    (own / "NotoSansThai-Bold.ttf").write_bytes(make_font({"\u0e01": [box(0, 0, 500, 100)]}))
    assert text_artwork("\u0e01").aspect == pytest.approx(160 / 560, rel=0.01)  # thickened: its weight says regular


def test_a_variable_font_serves_in_bold(own: Path) -> None:
    (own / "NotoSansThai[wdth,wght].ttf").write_bytes(make_font({"\u0e01": [SQUARE]}, widened="wght"))
    letters = text_artwork("\u0e01")
    assert letters.aspect == pytest.approx(0.5)  # and is not thickened
    assert [face.offset for face in letters.faces] == [0.0]


def test_a_collection_gives_the_face_that_has_the_letter(own: Path) -> None:
    shutil.copy(SYSTEM[1] / "NotoSansCJK-Bold.ttc", own / "Brand.ttc")
    assert next(face for face in general_faces("SC") if not face.lacks("\u751f")).name.startswith("Noto Sans")


@pytest.mark.parametrize("content", [b"", b"not a font", b"\0\1\0\0" + bytes(100), b"ttcf" + b"\xff" * 60])
def test_a_file_that_is_no_font_is_passed_over(own: Path, content: bytes) -> None:
    (own / "NotoSansThai-Bold.ttf").write_bytes(content)
    (own / "Other.ttf").write_bytes(content)
    with pytest.raises(MeshmarkError, match="U\\+E000"):
        set_text(PRIVATE)


def test_without_fonts_the_bundled_one_serves_and_the_packages_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("core.artwork.installed.SYSTEM", (tmp_path / "none",))
    assert names("watermark") == ["DejaVu Sans Bold"]
    assert names("\u05d0\u0628") == ["DejaVu Sans Bold"]  # which has these, too
    with pytest.raises(MeshmarkError) as caught:
        set_text("\u751f")
    assert "Debian package fonts-hanazono or fonts-noto-cjk" in caught.value.remedy
    with pytest.raises(MeshmarkError) as caught:
        set_text("\u0e01")
    assert "Debian package fonts-noto-core" in caught.value.remedy


def test_fonts_are_tried_in_the_same_order_each_time() -> None:
    first = [face.name for script in ("Thai", "Arab", "Hani") for face in faces_for(script, "JP")]
    assert first == [face.name for script in ("Thai", "Arab", "Hani") for face in faces_for(script, "JP")]
    assert first[0] == "Noto Sans Thai Bold"
    assert first[-1] == "Noto Sans CJK JP Bold"
