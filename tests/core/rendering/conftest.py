from collections.abc import Iterator

import pytest

from core.rendering.renderer import Renderer
from tests.core.rendering.shots import SIZE


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    with Renderer(SIZE) as renderer:
        yield renderer
