import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from core.errors import MeshmarkError
from worker.results import open_result, replace_result


def listen(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as line:
        line.bind(os.fspath(path))


@pytest.mark.parametrize(
    "make",
    [
        lambda path: path.symlink_to(path.with_name("private")),
        lambda path: path.symlink_to("/nowhere"),
        os.mkfifo,
        Path.mkdir,
        listen,
        lambda _path: None,
    ],
)
def test_what_is_no_plain_file_is_not_opened(make: Callable[[Path], object], tmp_path: Path) -> None:
    (tmp_path / "private").write_bytes(b"secret")
    make(tmp_path / "model.glb")
    with pytest.raises(MeshmarkError, match="left no file"):
        open_result(tmp_path / "model.glb")


def test_a_file_is_read_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "model.glb").write_bytes(b"glTF")
    with open_result(tmp_path / "model.glb") as file:
        assert file.read() == b"glTF"


def test_what_a_link_leads_to_is_not_written_to(tmp_path: Path) -> None:
    private, report = tmp_path / "private", tmp_path / "report.json"
    private.write_bytes(b"secret")
    report.symlink_to(private)
    replace_result(report, b"{}")
    assert (private.read_bytes(), report.read_bytes(), report.is_symlink()) == (b"secret", b"{}", False)
