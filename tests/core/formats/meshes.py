"""Real assets for the tests that can use them; the tests pass without."""

import os
from pathlib import Path

MESHES = Path(os.environ.get("MESHMARK_TEST_MESHES", Path(__file__).parents[4] / "shared" / "meshes"))


def real_glbs() -> list[Path]:
    """Every .glb of the folder MESHMARK_TEST_MESHES, by default ../shared/meshes beside the repository."""
    return sorted(MESHES.glob("*.glb"))
