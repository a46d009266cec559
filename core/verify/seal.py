"""Content Credentials of a suspect file, judged where the library for it is installed."""

from dataclasses import dataclass
from importlib.util import find_spec

from core.credentials.facts import Credentials
from core.errors import ErrorCode, MeshmarkError

MODEL = "model/gltf-binary"  # as results are signed; of a sidecar's file only the bytes count


@dataclass(frozen=True)
class Seal:
    """Means of the caller to judge a file's credentials.

    Attributes:
        sidecar: a manifest store that came beside the file.
        anchors: PEM of the root certificates that are trusted.
    """

    sidecar: bytes | None = None
    anchors: str | None = None


NO_SEAL = Seal()


def judge(data: bytes, picture: str | None, seal: Seal) -> Credentials | None:
    """The credentials of a file; None where the library that reads them is not installed.

    Args:
        data: the file.
        picture: its format where it is a picture.
        seal: to judge them by.

    Raises:
        MeshmarkError: as :func:`core.credentials.read.read_credentials`; ``unsupported_feature`` for a sidecar where
            the library is not installed.
    """
    if find_spec("c2pa") is None:
        if seal.sidecar is not None:
            raise MeshmarkError(
                ErrorCode.UNSUPPORTED_FEATURE,
                "Content Credentials cannot be read here: the extra c2pa is not installed.",
                "Install meshmark[c2pa], or leave the credentials out.",
            )
        return None
    from core.credentials.read import read_credentials

    return read_credentials(data, f"image/{picture}" if picture else MODEL, seal.sidecar, seal.anchors)
