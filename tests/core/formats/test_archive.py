import contextlib
import io
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.archive import Archive
from tests.core.formats.samples import zipped
from tests.cost import cost

MEGABYTE = 2**20


def _read_all(data: bytes, budgets: Budgets) -> None:
    archive = Archive(data, budgets)
    for name in archive.names:
        archive.read(name)


def _refusal(data: bytes, budgets: Budgets | None = None) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        _read_all(data, budgets or Budgets())
    assert caught.value.message.endswith(".")
    return caught.value


def _entry(change: Callable[[zipfile.ZipInfo], None], content: bytes = b"v 0 0 0\n") -> bytes:
    """An archive with one entry whose header was changed."""
    info = zipfile.ZipInfo("cow.obj")
    change(info)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(info, content)
    return stream.getvalue()


def _with_directory(data: bytes, offset: int, value: bytes) -> bytes:
    """The archive with other bytes at an offset into the first entry of its directory."""
    at = data.index(b"PK\x01\x02") + offset
    return data[:at] + value + data[at + len(value) :]


def _bomb(names: int = 1) -> bytes:
    return zipped({f"{number}.obj": bytes(100 * MEGABYTE) for number in range(names)})


def _overlapping() -> bytes:
    """Two entries of the directory for the same packed bytes, as in the 42 kB that unpack to petabytes."""
    data = zipped({"a.obj": bytes(1000), "b.obj": bytes(1000)})
    first, end = data.index(b"PK\x01\x02"), data.rindex(b"PK\x05\x06")
    second = data.index(b"PK\x01\x02", first + 1)
    name = data.index(b"b.obj")
    one = data[: name - 30]  # only the first packed entry is left
    directory = data[first:second] + data[second : second + 42] + struct.pack("<I", 0) + data[second + 46 : end]
    return one + directory + data[end : end + 12] + struct.pack("<II", len(directory), len(one)) + b"\0\0"


def test_files_are_listed_in_order_without_what_operating_systems_add() -> None:
    names = ["cow.obj", "__MACOSX/._cow.obj", ".DS_Store", "tex/Thumbs.db", "tex/cow.png", "tex/._cow.png"]
    archive = Archive(zipped(dict.fromkeys(names, "content")), Budgets())
    assert archive.names == ["cow.obj", "tex/cow.png"]
    assert archive.read("tex/cow.png") == b"content"


@pytest.mark.parametrize(
    ("data", "code", "said"),
    [
        (zipped({"../../etc/passwd": "x"}), ErrorCode.MALFORMED_FILE, "../../etc/passwd"),
        (zipped({"/etc/passwd": "x"}), ErrorCode.MALFORMED_FILE, "outside"),
        (zipped({"a/../../b.obj": "x"}), ErrorCode.MALFORMED_FILE, "outside"),
        (zipped({"C:\\cow.obj": "x"}), ErrorCode.MALFORMED_FILE, "outside"),
        (zipped({"..\\cow.obj": "x"}), ErrorCode.MALFORMED_FILE, "outside"),
        (zipped({"a/cow.obj": "x", "a\\cow.obj": "y"}), ErrorCode.MALFORMED_FILE, "two entries"),
        (zipped({"cow.obj": "x", "more.zip": "y"}), ErrorCode.UNSUPPORTED_FEATURE, "another archive"),
        (
            _entry(lambda info: setattr(info, "external_attr", (stat.S_IFLNK | 0o777) << 16)),
            ErrorCode.MALFORMED_FILE,
            "link",
        ),
        (
            _entry(lambda info: setattr(info, "compress_type", zipfile.ZIP_BZIP2)),
            ErrorCode.UNSUPPORTED_FEATURE,
            "bzip2",
        ),
        (_with_directory(zipped({"cow.obj": "x"}), 8, b"\x01\x00"), ErrorCode.UNSUPPORTED_FEATURE, "encrypted"),
        (_with_directory(zipped({"cow.obj": "x"}), 10, b"\x63\x00"), ErrorCode.UNSUPPORTED_FEATURE, "method 99"),
        (_bomb(), ErrorCode.BUDGET_EXCEEDED, "104,857,600"),
        (_overlapping(), ErrorCode.MALFORMED_FILE, "before the next one"),
        (zipped({"cow.obj": "x" * 50})[:-30], ErrorCode.TRUNCATED_FILE, "directory"),
        (b"PK\x03\x04" + bytes(40), ErrorCode.TRUNCATED_FILE, "directory"),
        (_with_directory(zipped({"cow.obj": "x" * 50}), 0, b"PK\x09"), ErrorCode.MALFORMED_FILE, "directory"),
    ],
)
def test_a_hostile_or_damaged_archive_is_refused_for_its_reason(data: bytes, code: ErrorCode, said: str) -> None:
    error = _refusal(data)
    assert error.code is code
    assert said in error.message


@pytest.mark.parametrize("declared", [1, 40, 60])
def test_a_directory_that_lies_about_a_size_is_found_out_without_unpacking_more(declared: int) -> None:
    data = _with_directory(zipped({"cow.obj": "x" * 50}), 24, struct.pack("<I", declared))
    error = _refusal(data)
    assert error.code is ErrorCode.MALFORMED_FILE
    assert f"{declared} declared bytes" in error.message


def test_damaged_content_is_refused() -> None:
    data = bytearray(zipped({"cow.obj": bytes(range(256)) * 4}))
    data[60] ^= 0xFF
    assert _refusal(bytes(data)).code is ErrorCode.MALFORMED_FILE


@pytest.mark.parametrize(
    ("budgets", "said"),
    [(Budgets(archive_entries=3), "4 entries"), (Budgets(unpacked_bytes=3999), "4,000 bytes of unpacked files")],
)
def test_an_archive_over_a_budget_is_refused_naming_its_number(budgets: Budgets, said: str) -> None:
    error = _refusal(zipped({f"{number}.obj": bytes(1000) for number in range(4)}), budgets)
    assert error.code is ErrorCode.BUDGET_EXCEEDED
    assert said in error.message


@pytest.mark.parametrize(
    "data",
    [
        _bomb(),
        _bomb(6),
        _overlapping(),
        b"PK\x05\x06" + b"PK\x01\x02" * 100_000,
        zipped(dict.fromkeys(map(str, range(5000)), "")),
    ],
    ids=["bomb", "six bombs", "overlapping", "signatures", "many entries"],
)
def test_an_attack_costs_neither_time_nor_memory(data: bytes) -> None:
    with cost() as spent:
        _refusal(data)
    assert spent.calls < 100_000
    assert spent.peak < MEGABYTE


def test_references_are_found_relative_to_the_file_that_makes_them() -> None:
    archive = Archive(zipped(dict.fromkeys(["a/model.gltf", "a/b/c d.bin", "Tex/Cow.PNG"], "x")), Budgets())
    assert archive.find("b/c%20d.bin", "a/model.gltf") == "a/b/c d.bin"
    assert archive.find("..\\tex\\cow.png", "a/model.gltf") == "Tex/Cow.PNG"
    assert archive.find("missing.bin", "a/model.gltf") is None
    assert archive.find_by_name("C:\\Users\\me\\cow.png") == "Tex/Cow.PNG"


def _raw_zip(names: list[bytes]) -> bytes:
    """An archive whose names are bytes, as packers write them that do not know UTF-8."""
    marked = [b"\x01" * len(name) for name in names]
    assert len({len(name) for name in names}) == len(names), "told apart by their length"
    data = zipped({name.decode(): "content" for name in marked})
    for raw, mark in sorted(zip(names, marked, strict=True), key=lambda pair: -len(pair[0])):
        data = data.replace(mark, raw)
    return data


@pytest.mark.parametrize(
    ("name", "reference"),
    [
        ("wood #2.png", "wood #2.png"),
        ("wood #2.png", "wood%20%232.png"),
        ("what? really.png", "what? really.png"),
        ("100% wool.png", "100% wool.png"),
        ("a b.png", "a%2520b.png"),
        ("a%20b.png", "a%20b.png"),
        ("a+b.png", "a+b.png"),
        ("cow.png", "cow.png?v=2"),
        ("cow.png", "./cow.png#main"),
        ("tex/cow.png", "TEX\\Cow.png"),
        ("gru\u0308n.png", "gr%C3%BCn.png"),
        ("gr\u00fcn.png", "gru\u0308n.png"),
        ("gr\u00fcn.png", "GR\u00dcN.png"),
        ("gr\u00fcn.png", "gr%FCn.png"),
        ("gr\u00fcn.png", b"gr\xfcn.png"),
        ("gr\u00fcn.png", b"gr\x81n.png"),
        ("gr\u00fcn.png", "gr\u00fcn.png".encode()),
        ("\u0414\u0435\u0440.png", "\u0414\u0435\u0440.png".encode("cp1251")),
        ("\u8868\u7d19.png", "\u8868\u7d19.png".encode("cp932")),
        ("\u6728\u5934.png", "\u6728\u5934.png".encode("gb18030")),
    ],
)
@pytest.mark.parametrize("escaped", [True, False])
def test_a_file_is_found_however_its_name_was_written(name: str, reference: str | bytes, escaped: bool) -> None:
    archive = Archive(zipped({"model.gltf": "x", name: "content", "other.png": "y"}), Budgets())
    assert archive.find(reference, "model.gltf", escaped=escaped) == name


@pytest.mark.parametrize(
    ("packed", "shown"),
    [
        ("gr\u00fcn.png".encode("cp850"), "gr\u00fcn.png"),
        ("\u0414\u0435\u0440\u0435\u0432\u043e.png".encode("cp866"), "\u0414\u0435\u0440\u0435\u0432\u043e.png"),
        ("\u91d1\u5c5e\u6750\u8d28.png".encode("gb18030"), "\u91d1\u5c5e\u6750\u8d28.png"),
        ("\u30c6\u30af\u30b9\u8868.png".encode("cp932"), "\u30c6\u30af\u30b9\u8868.png"),
        ("gr\u00fcn.png".encode(), "gr\u00fcn.png"),
    ],
)
def test_names_packed_in_a_code_page_are_shown_as_they_are_meant_and_found(packed: bytes, shown: str) -> None:
    archive = Archive(_raw_zip([b"m.obj", packed]), Budgets())
    assert archive.names == ["m.obj", shown]
    assert archive.read(shown) == b"content"
    for reference in (packed, shown, shown.encode()):
        assert archive.find(reference, "m.obj", escaped=False) == shown


def test_a_name_that_the_archive_also_says_in_utf_8_is_that_unless_it_was_changed_since() -> None:
    raw, said = b"gr\x81n.png", "grün ✓.png".encode()

    def archive(crc: int) -> Archive:
        info = zipfile.ZipInfo("#" * len(raw))
        field = struct.pack("<BI", 1, crc) + said
        info.extra = struct.pack("<HH", 0x7075, len(field)) + field
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w") as file:
            file.writestr(info, "content")
        return Archive(stream.getvalue().replace(b"#" * len(raw), raw), Budgets())

    assert archive(zlib.crc32(raw)).names == [said.decode()]
    assert archive(zlib.crc32(raw)).read(said.decode()) == b"content"
    assert archive(0).names == ["grün.png"]


@given(extra=st.binary(max_size=24), name=st.binary(min_size=1, max_size=12).filter(lambda name: b"#" not in name))
def test_any_name_and_extra_field_is_read_or_refused(extra: bytes, name: bytes) -> None:
    info = zipfile.ZipInfo("#" * len(name))
    info.extra = extra
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        file.writestr(info, "content")
    with contextlib.suppress(MeshmarkError):
        archive = Archive(stream.getvalue().replace(b"#" * len(name), name), Budgets())
        for entry in archive.names:
            assert not entry.startswith(("/", "../"))
            archive.read(entry)
            assert archive.find(entry, "", escaped=False) == entry


def test_what_a_reference_says_by_the_rules_goes_before_what_it_may_mean() -> None:
    archive = Archive(zipped(dict.fromkeys(["a b.png", "a%20b.png", "cow.png", "cow.png#1"], "x")), Budgets())
    assert archive.find("a%20b.png", "model.gltf") == "a b.png"
    assert archive.find("a%20b.png", "model.mtl", escaped=False) == "a%20b.png"
    assert archive.find("cow.png#1", "model.gltf") == "cow.png"


def test_a_path_of_another_machine_is_located_by_its_last_name_if_one_file_has_it() -> None:
    archive = Archive(zipped(dict.fromkeys(["tex/Cow #1.png", "a/x.png", "b/x.png"], "x")), Budgets())
    assert archive.locate("file:///C:/me/Cow%20%231.png", "model.gltf") == "tex/Cow #1.png"
    assert archive.locate("C:\\me\\cow #1.png", "model.gltf") == "tex/Cow #1.png"
    assert archive.locate("/home/x.png", "model.gltf") is None
    assert archive.locate("b/x.png", "model.gltf") == "b/x.png"


def test_what_a_reference_may_mean_is_guessed_for_no_more_missing_files_than_an_archive_may_have() -> None:
    archive = Archive(zipped({"wood #2.png": "x", "wood.png": "y"}), Budgets(archive_entries=5))
    for number in range(6):
        assert archive.find("wood #2.png", "model.gltf") == "wood #2.png"
        assert archive.find(f"missing{number}.png", "model.gltf") is None
    assert archive.find("wood #2.png", "model.gltf") is None
    assert archive.find("wood.png", "model.gltf") == "wood.png"


@pytest.mark.parametrize(
    "uri",
    ["http://evil.example/x.bin", "file:///etc/passwd", "//host/x", "/etc/passwd", "../../x", "%2e%2e/%2e%2e/x", ""],
)
def test_a_reference_that_leads_out_of_the_archive_is_refused(uri: str) -> None:
    archive = Archive(zipped({"a/model.gltf": "x"}), Budgets())
    with pytest.raises(MeshmarkError) as caught:
        archive.find(uri, "a/model.gltf")
    assert caught.value.code is ErrorCode.EXTERNAL_REFERENCE


def test_several_models_in_one_archive_are_refused_by_name() -> None:
    archive = Archive(zipped(dict.fromkeys(["cow.obj", "pig.OBJ"], "x")), Budgets())
    with pytest.raises(MeshmarkError, match=r"2 models: 'cow.obj', 'pig.OBJ'") as caught:
        archive.only(".obj")
    assert caught.value.code is ErrorCode.UNSUPPORTED_FEATURE
