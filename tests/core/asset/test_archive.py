import io
import stat
import struct
import zipfile
from collections.abc import Callable

import pytest

from core.asset.archive import Archive
from core.asset.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from tests.core.asset.samples import zipped
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
