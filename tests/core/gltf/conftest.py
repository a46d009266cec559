import numpy as np
import pytest
from numpy.typing import NDArray


@pytest.fixture
def in_file_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows and triangles stay in the order of the file, new ones behind them, so that a test can say which it means."""

    def as_they_come(points: NDArray[np.float64]) -> NDArray[np.int64]:
        return np.arange(len(points))

    monkeypatch.setattr("core.gltf.write.morton_order", as_they_come)
    monkeypatch.setattr("core.gltf.write._from_lowest", lambda rows: rows)
