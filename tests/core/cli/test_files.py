"""Files of the command line."""

from pathlib import Path

import pytest

from core.cli.files import write_file
from core.errors import ErrorCode, MeshmarkError


def test_what_cannot_be_written_leaves_nothing_half_written(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(MeshmarkError, match="cannot be written") as caught:
        write_file(tmp_path / "folder", b"a model")
    assert caught.value.code is ErrorCode.OUTPUT_NOT_WRITABLE
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]
