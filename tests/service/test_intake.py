import tracemalloc
from pathlib import Path

import pytest

from core.asset.budgets import DEFAULT_BUDGETS
from core.errors import ErrorCode, MeshmarkError
from service.intake import check_asset

MIB = 2**20


def test_the_error_does_not_keep_the_refused_asset_in_memory(tmp_path: Path) -> None:
    path = tmp_path / "asset"
    path.write_bytes(b"v 0 0 0\n" * MIB)
    tracemalloc.start()
    try:
        with pytest.raises(MeshmarkError) as refusal:
            check_asset(path, DEFAULT_BUDGETS)
        held, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert refusal.value.code is ErrorCode.NO_FACES
    assert held < MIB < 8 * MIB <= peak
