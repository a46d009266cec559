"""ZIP archives, read in memory: the whole directory is checked before any entry is unpacked, nothing touches a disk."""

import io
import posixpath
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator
from functools import cached_property
from urllib.parse import unquote_to_bytes

from core.budgets import Budgets, within
from core.errors import ErrorCode, MeshmarkError
from core.formats.names import code_page, decode, decoded, folded, spellings
from core.refusals import malformed, truncated

MAGIC = (b"PK\x03\x04", b"PK\x05\x06")

# Files that operating systems add to a folder before they pack it.
_IGNORED = re.compile(r"(^|/)(__MACOSX/|\.DS_Store$|Thumbs\.db$|desktop\.ini$|\._)", re.IGNORECASE)
_NESTED = re.compile(r"\.(zip|7z|rar|gz|tgz|bz2|xz|zst|tar|usdz|zae)$", re.IGNORECASE)
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_OTHER_METHODS = {1: "shrinking", 6: "imploding", 9: "Deflate64", 12: "bzip2", 14: "LZMA", 93: "Zstandard", 95: "XZ"}
_SMALL = 2**20  # bytes; entries up to this size may have any ratio of compression
_LOCAL_HEADER_BYTES = 30
_UNICODE_PATH = 0x7075


class Archive:
    """A ZIP file whose directory is sound.

    Args:
        data: the whole file.
        budgets: bounds its entries, and the bytes that they unpack to.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file``, ``budget_exceeded``, or ``unsupported_feature`` for
            encrypted, nested or unusually compressed entries.
    """

    def __init__(self, data: bytes, budgets: Budgets) -> None:
        # every entry of the directory starts with this signature, so this bounds what reading the directory costs
        within(data.count(b"PK\x01\x02"), budgets.archive_entries, "entries in the archive")
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(data))
        # All that zipfile raises on directories that lie or ask for what it cannot do.
        except (zipfile.BadZipFile, struct.error, ValueError, OSError, NotImplementedError):
            if b"PK\x05\x06" not in data:
                raise truncated("The ZIP archive is cut off: its directory, which comes last, is missing.") from None
            raise malformed("The directory of the ZIP archive is damaged.") from None
        page = code_page(_raw_name(entry) for entry in self._zip.infolist() if not _is_utf8(entry))
        entries, names = [], []
        for entry in self._zip.infolist():
            name = _unicode_name(entry) or decoded(_raw_name(entry), page) or entry.filename
            _check_name(name, entry)
            if not entry.is_dir():
                entries.append(entry)
                names.append(_normal(name))
        self._entries = {name: entry for name, entry in zip(names, entries, strict=True) if not _IGNORED.search(name)}
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise malformed(f"The ZIP archive has two entries of the name {_quote(twice)}.")
        for entry in entries:
            _check_entry(entry, budgets)
        within(sum(entry.file_size for entry in entries), budgets.unpacked_bytes, "bytes of unpacked files")
        _check_overlap(entries, self._zip.start_dir)
        self._guesses = budgets.archive_entries  # bound of references to files that the archive does not have

    @property
    def names(self) -> list[str]:
        """The names of all files, in the order of the directory; those that operating systems add are left out."""
        return list(self._entries)

    def size(self, name: str) -> int:
        """Bytes that a file unpacks to, as declared; :meth:`read` never gives more."""
        return self._entries[name].file_size

    def read(self, name: str) -> bytes:
        """The content of one of :attr:`names`.

        Raises:
            MeshmarkError: ``malformed_file`` where it contradicts the directory.
        """
        entry = self._entries[name]
        try:
            with self._zip.open(entry) as file:  # stops at the declared size, also where more is packed
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

    def find(self, reference: str | bytes, beside: str, *, escaped: bool = True) -> str | None:
        """The name of the file that a reference in the file ``beside`` means; ``None`` where there is none.

        Exporters write backslashes, unescaped names in place of URIs and URIs in place of names, escape twice, and
        ignore code pages and case: the reading by the rules comes first, then the others.

        Args:
            reference: a URI, or a path.
            beside: one of :attr:`names`, which the reference is relative to.
            escaped: it is a URI by the rules of the format, not a path.

        Raises:
            MeshmarkError: ``external_reference`` for a reference that leads out of the archive.
        """
        paths = [_inside_path(text, beside) for text in self._readings(reference, escaped)]
        for path in paths:
            if path in self._entries:
                return path
        for path in paths:
            if path is not None and (found := self._by_folded_name.get(folded(path))) is not None:
                return found
        self._guesses -= 1
        if None in paths or not paths:
            raise outside(reference, beside)
        return None

    def find_by_name(self, reference: str | bytes) -> str | None:
        """The one file whose last name is that of a reference, whatever its folder; ``None`` where not just one."""
        for text in self._readings(reference, escaped=True):
            found = self._by_last_name.get(folded(posixpath.basename(text.replace("\\", "/"))), ())
            if len(found) == 1:
                return next(iter(found))
        return None

    def locate(self, reference: str | bytes, beside: str, *, escaped: bool = True) -> str | None:
        """As :meth:`find`, else as :meth:`find_by_name`: paths of the machine that wrote the file lead nowhere here."""
        try:
            found = self.find(reference, beside, escaped=escaped)
        except MeshmarkError:
            found = None
        return found or self.find_by_name(reference)

    def _readings(self, reference: str | bytes, escaped: bool) -> Iterator[str]:
        """Paths that a reference can mean, the likeliest first: with fewer or more escapes, each in every code page."""
        raw = reference.encode("utf-8", "surrogatepass") if isinstance(reference, str) else reference
        once = unquote_to_bytes(raw)
        path = unquote_to_bytes(re.split(rb"[?#]", raw)[0])
        likeliest_first = (path, once, raw) if escaped else (raw, once, path)
        for meant in dict.fromkeys((*likeliest_first, unquote_to_bytes(once), unquote_to_bytes(path))):
            if meant:
                yield from spellings(meant)
            if self._guesses < 0:
                return

    @cached_property
    def _by_folded_name(self) -> dict[str, str]:
        """Names by the folded forms that match them; a name's own form goes before the other readings of any."""
        table = {folded(name): name for name in reversed(self._entries)}
        for name, entry in self._entries.items():
            if not _is_utf8(entry):
                for text in spellings(_raw_name(entry)):
                    table.setdefault(folded(_normal(text)), name)
        return table

    @cached_property
    def _by_last_name(self) -> dict[str, set[str]]:
        table: dict[str, set[str]] = {}
        for path, name in self._by_folded_name.items():
            table.setdefault(posixpath.basename(path), set()).add(name)
        return table


def _inside_path(text: str, beside: str) -> str | None:
    """The path within an archive of one relative to the file ``beside``; ``None`` where it leads out of it."""
    path = text.replace("\\", "/")
    joined = posixpath.normpath(posixpath.join(posixpath.dirname(beside), path))
    if (
        path.startswith("/")
        or re.match(r"[A-Za-z][A-Za-z0-9+.-]*:", path)
        or joined.startswith("../")
        or joined == ".."
    ):
        return None
    return joined


def outside(reference: str | bytes, beside: str) -> MeshmarkError:
    """The error for a reference to something that was not uploaded."""
    uri = decode(reference) if isinstance(reference, bytes) else reference
    return MeshmarkError(
        ErrorCode.EXTERNAL_REFERENCE,
        f"{_quote(beside)} refers to {_quote(uri)}; nothing outside the uploaded file is opened.",
        "Put the file into the archive and refer to it by a relative path, or send a self-contained GLB.",
    )


def _normal(name: str) -> str:
    return posixpath.normpath(name.replace("\\", "/"))


def _quote(name: str) -> str:
    return repr(name if len(name) <= 60 else name[:60] + "...")


def _is_utf8(entry: zipfile.ZipInfo) -> bool:
    return bool(entry.flag_bits & 0x800)


def _raw_name(entry: zipfile.ZipInfo) -> bytes:
    """The bytes of the name in the archive: zipfile takes all that is not UTF-8 for code page 437."""
    return entry.orig_filename.partition("\0")[0].encode("utf-8" if _is_utf8(entry) else "cp437")


def _unicode_name(entry: zipfile.ZipInfo) -> str | None:
    """The name where the archive says it in UTF-8: as such, or in Info-ZIP's extra field (APPNOTE 4.6.9)."""
    if _is_utf8(entry):
        return entry.filename
    at = 0
    while at + 4 <= len(entry.extra):
        kind, size = struct.unpack_from("<HH", entry.extra, at)
        field = entry.extra[at + 4 : at + 4 + size]
        if kind == _UNICODE_PATH and field[1:5] == struct.pack("<I", zlib.crc32(_raw_name(entry))):
            return decoded(field[5:], "utf-8")
        at += 4 + size
    return None


def _check_name(decoded: str, entry: zipfile.ZipInfo) -> None:
    name = decoded.replace("\\", "/")
    if name.startswith("/") or re.match(r"[A-Za-z]:", name) or ".." in name.split("/") or not name or "\0" in name:
        raise malformed(f"The ZIP archive has an entry {_quote(decoded)}, which would lie outside of it.")
    if stat.S_ISLNK(entry.external_attr >> 16):
        raise malformed(f"The entry {_quote(decoded)} of the ZIP archive is a link, not a file.")


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
