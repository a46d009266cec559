"""A model as uploaded: on its own, or in an archive with the files that belong to it."""

from dataclasses import dataclass

from core.formats.archive import Archive


@dataclass(frozen=True, eq=False)
class Source:
    """A model and the archive around it.

    Attributes:
        data: the model itself.
        archive: that contained it; None where it was uploaded on its own.
        name: of the model in its archive; empty where it was uploaded on its own.
    """

    data: bytes
    archive: Archive | None = None
    name: str = ""

    def load(self, path: str | bytes, *, escaped: bool = True) -> bytes | None:
        """The file that the model refers to by ``path``; None where it is not in the upload.

        Args:
            path: relative to the model, or valid in its last part only.
            escaped: the path is a URI reference, with percent escapes.

        Raises:
            MeshmarkError: as :meth:`core.formats.archive.Archive.locate` and ``read`` there.
        """
        if self.archive is None or (found := self.archive.locate(path, self.name, escaped=escaped)) is None:
            return None
        return self.archive.read(found)
