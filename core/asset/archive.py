"""ZIP archives, read in memory: the whole directory is checked before any entry is unpacked, nothing touches a disk."""

import io
import posixpath
import re
import stat
import struct
import zipfile
import zlib
from functools import cached_property
from urllib.parse import unquote, urlsplit

from core.asset.budgets import Budgets, within
from core.asset.refusals import malformed, truncated
from core.errors import ErrorCode, MeshmarkError

MAGIC = (b"PK\x03\x04", b"PK\x05\x06")

# What operating systems add to a folder before they pack it.
_IGNORED = re.compile(r"(^|/)(__MACOSX/|\.DS_Store$|Thumbs\.db$|desktop\.ini$|\._)", re.IGNORECASE)
_NESTED = re.compile(r"\.(zip|7z|rar|gz|tgz|bz2|xz|zst|tar|3mf|usdz|zae)$", re.IGNORECASE)
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_OTHER_METHODS = {1: "shrinking", 6: "imploding", 9: "Deflate64", 12: "bzip2", 14: "LZMA", 93: "Zstandard", 95: "XZ"}
_SMALL = 2**20  # an entry of up to a megabyte may be as repetitive as it likes
_LOCAL_HEADER_BYTES = 30


class Archive:
    """A ZIP file whose directory is sound.

    Args:
        data: the whole file.
        budgets: how many entries it may have, and how many bytes they may unpack to.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file``, ``budget_exceeded``, or ``unsupported_feature`` for
            encrypted, nested or unusually compressed entries.
    """

    def __init__(self, data: bytes, budgets: Budgets) -> None:
        # every entry of the directory starts with this signature, so this bounds what reading the directory costs
        within(data.count(b"PK\x01\x02"), budgets.archive_entries, "entries in the archive")
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(data))
        except (zipfile.BadZipFile, struct.error, ValueError, OSError, NotImplementedError):
            if b"PK\x05\x06" not in data:
                raise truncated("The ZIP archive is cut off: its directory, which comes last, is missing.") from None
            raise malformed("The directory of the ZIP archive is damaged.") from None
        for entry in self._zip.infolist():
            _check_name(entry)
        entries = [entry for entry in self._zip.infolist() if not entry.is_dir()]
        self._entries = {_normal(entry.filename): entry for entry in entries if not _IGNORED.search(entry.filename)}
        names = [_normal(entry.filename) for entry in entries]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise malformed(f"The ZIP archive has two entries of the name {_quote(twice)}.")
        for entry in entries:
            _check_entry(entry, budgets)
        within(sum(entry.file_size for entry in entries), budgets.unpacked_bytes, "bytes of unpacked files")
        _check_overlap(entries, self._zip.start_dir)

    @property
    def names(self) -> list[str]:
        """The names of all files, in the order of the directory; what operating systems add is left out."""
        return list(self._entries)

    def size(self, name: str) -> int:
        """Bytes that a file unpacks to, as declared; :meth:`read` never gives more."""
        return self._entries[name].file_size

    def read(self, name: str) -> bytes:
        """The content of one of :attr:`names`.

        Raises:
            MeshmarkError: ``malformed_file`` where it is not what the directory declares.
        """
        entry = self._entries[name]
        try:
            with self._zip.open(entry) as file:  # stops at the declared size, however much more is packed
                content = file.read()
        except (zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, ValueError, RuntimeError):
            content = b""
        if len(content) != entry.file_size:
            raise malformed(
                f"{_quote(name)} of the ZIP archive does not unpack to the {entry.file_size:,} declared bytes."
            )
        return content

    def only(self, *endings: str) -> str:
        """The one file with one of these endings, the main file of the archive.

        Raises:
            MeshmarkError: ``unsupported_feature`` where there are several, ``malformed_file`` where there is none.
        """
        found = [name for name in self._entries if name.lower().endswith(endings)]
        if not found:
            raise malformed(f"The ZIP archive has no {endings[0]} file.")
        if len(found) > 1:
            names = ", ".join(_quote(name) for name in found[:3]) + (", ..." if len(found) > 3 else "")
            raise _unsupported(
                f"The ZIP archive holds {len(found):,} models: {names}.", "Send each model in an archive of its own."
            )
        return found[0]

    def find(self, uri: str, beside: str) -> str | None:
        """The name of the file that a relative URI in the file ``beside`` means; ``None`` where there is none.

        Exporters on other systems write backslashes and do not mind upper and lower case.

        Raises:
            MeshmarkError: ``external_reference`` for a URI that leads out of the archive.
        """
        if (path := inside_path(uri, beside)) is None:
            raise outside(uri, beside)
        if path in self._entries:
            return path
        return self._by_folded_name.get(path.casefold())

    def find_by_name(self, path: str) -> str | None:
        """The one file whose last name is that of ``path``, whatever folder it lies in; ``None`` where not just one."""
        wanted = posixpath.basename(path.replace("\\", "/")).casefold()
        found = [name for name in self._entries if posixpath.basename(name).casefold() == wanted]
        return found[0] if len(found) == 1 else None

    @cached_property
    def _by_folded_name(self) -> dict[str, str]:
        return {name.casefold(): name for name in self._entries}


def inside_path(uri: str, beside: str) -> str | None:
    """The path within an archive of a URI relative to the file ``beside``; ``None`` where it leads out of it."""
    try:
        parts = urlsplit(uri.replace("\\", "/"))
    except ValueError:
        return None
    path = unquote(parts.path)
    joined = posixpath.normpath(posixpath.join(posixpath.dirname(beside), path))
    if parts.scheme or parts.netloc or not path or path.startswith("/") or joined.startswith("../") or joined == "..":
        return None
    return joined


def outside(uri: str, beside: str) -> MeshmarkError:
    """The error for a reference to something that was not uploaded."""
    return MeshmarkError(
        ErrorCode.EXTERNAL_REFERENCE,
        f"{_quote(beside)} refers to {_quote(uri)}; nothing outside the uploaded file is opened.",
        "Put the file into the archive and refer to it by a relative path, or send a self-contained GLB.",
    )


def _normal(name: str) -> str:
    return posixpath.normpath(name.replace("\\", "/"))


def _quote(name: str) -> str:
    return repr(name if len(name) <= 60 else name[:60] + "...")


def _check_name(entry: zipfile.ZipInfo) -> None:
    name = entry.filename.replace("\\", "/")
    if name.startswith("/") or re.match(r"[A-Za-z]:", name) or ".." in name.split("/") or not name or "\0" in name:
        raise malformed(f"The ZIP archive has an entry {_quote(entry.filename)}, which would lie outside of it.")
    if stat.S_ISLNK(entry.external_attr >> 16):
        raise malformed(f"The entry {_quote(entry.filename)} of the ZIP archive is a link, not a file.")


def _check_entry(entry: zipfile.ZipInfo, budgets: Budgets) -> None:
    name, packed, unpacked = _quote(entry.filename), entry.compress_size, entry.file_size
    if entry.flag_bits & 0x1:
        raise _unsupported(f"The entry {name} of the ZIP archive is encrypted.", "Pack the files without a password.")
    if entry.compress_type not in _METHODS:
        method = _OTHER_METHODS.get(entry.compress_type, f"method {entry.compress_type}")
        raise _unsupported(
            f"The entry {name} of the ZIP archive is compressed by {method}.",
            "Pack the files with plain ZIP (deflate).",
        )
    if _NESTED.search(entry.filename):
        raise _unsupported(
            f"The ZIP archive holds another archive, {name}.", "Pack the files of one model into one archive."
        )
    if unpacked > max(_SMALL, budgets.archive_ratio * packed):
        raise MeshmarkError(
            ErrorCode.BUDGET_EXCEEDED,
            f"The entry {name} of the ZIP archive unpacks from {packed:,} to {unpacked:,} bytes; "
            f"at most {budgets.archive_ratio} times as many are accepted.",
            "Send the unpacked model as a GLB.",
        )


def _check_overlap(entries: list[zipfile.ZipInfo], directory: int) -> None:
    """Refuse entries that share their bytes, by which a small archive unpacks to petabytes."""
    by_offset = sorted(entries, key=lambda entry: entry.header_offset)
    starts = [entry.header_offset for entry in by_offset] + [directory]
    for entry, following in zip(by_offset, starts[1:], strict=True):
        end = entry.header_offset + _LOCAL_HEADER_BYTES + entry.compress_size
        if entry.header_offset < 0 or end > following:
            raise malformed(
                f"The entry {_quote(entry.filename)} of the ZIP archive takes {entry.compress_size:,} bytes, "
                f"more than there are before the next one."
            )


def _unsupported(message: str, remedy: str) -> MeshmarkError:
    return MeshmarkError(ErrorCode.UNSUPPORTED_FEATURE, message, remedy)
