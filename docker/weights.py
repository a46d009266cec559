"""A step of the Dockerfile: `weights.py fetch|none FOLDER` fetches all weights into a folder, or leaves it empty."""

import sys
from pathlib import Path

from core.errors import MeshmarkError
from core.models import MODELS, fetch


def main(what: str, folder: Path) -> None:
    """Fill the folder."""
    folder.mkdir(parents=True)
    if what not in ("fetch", "none"):
        sys.exit(f"WEIGHTS is fetch or none, not {what!r}.")
    if what == "none":
        print("Built without the weights of ResNet50: ss is measured by the hand-made descriptor.")
        return
    for name in MODELS:
        try:
            path = fetch(name, folder)
        except MeshmarkError as error:
            sys.exit(f"{error.message}\n{error.remedy}\nTo build without weights: --build-arg WEIGHTS=none")
        path.with_name(f"{path.name}.lock").unlink()
        path.chmod(0o444)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
