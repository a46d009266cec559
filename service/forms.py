"""Streaming parser of forms with files (RFC 7578), which are spooled to the disk where they will be staged."""

from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import BinaryIO
from urllib.parse import parse_qsl

from fastapi.concurrency import run_in_threadpool
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.datastructures import FormData, Headers, UploadFile
from starlette.requests import Request
from starlette.types import Receive, Scope

from core.errors import ErrorCode, MeshmarkError
from service.jobs.artifacts import writing

Spool = Callable[[], BinaryIO]
LISTS = {"copies": 2**20}  # bytes of fields that may be longer than the others
CHARSETS = ("utf-8", "utf8", "us-ascii")
HOW_TO_SEND_TEXT = "Send all text as UTF-8: fields, their names and the names of files."


class FormRequest(Request):
    """Request whose form is parsed in threads, into files that `spool` makes.

    Unlike the framework's own parser, it refuses text that is not UTF-8 instead of reading it as Latin-1, tells a full
    disk from a malformed form, and does not write once for every small chunk of a file.
    """

    def __init__(self, scope: Scope, receive: Receive, spool: Spool) -> None:
        super().__init__(scope, receive)
        self._spool = spool

    async def _get_form(
        self, *, max_files: float = 1000, max_fields: float = 1000, max_part_size: int = 2**20
    ) -> FormData:
        if self._form is None:
            media_type, options = parse_options_header(self.headers.get("Content-Type"))
            charset = options.get(b"charset", b"utf-8").decode("latin-1").lower()
            if charset not in CHARSETS:
                raise _broken(f"it is declared to be in another character set than UTF-8 ({charset[:40]})")
            if media_type == b"multipart/form-data":
                boundary = options.get(b"boundary", b"")
                parts = _Parts(boundary, self._spool, max_files, max_fields, max_part_size)
                self._form = await self._read(parts)
            elif media_type == b"application/x-www-form-urlencoded":
                self._form = await self._read(_Fields(max_fields, max_part_size))
            else:
                self._form = FormData()
        return self._form

    async def _read(self, form: "_Parts | _Fields") -> FormData:
        try:
            async for chunk in self.stream():
                await run_in_threadpool(form.feed, chunk)
            return await run_in_threadpool(form.end)
        except BaseException:
            form.close()
            raise


class _Parts:
    """Parser of a multipart form."""

    def __init__(self, boundary: bytes, spool: Spool, max_files: float, max_fields: float, max_part_size: int) -> None:
        if not boundary:
            raise _broken("its Content-Type names no boundary")
        self._spool = spool
        self._files_left, self._fields_left, self._max_part_size = max_files, max_fields, max_part_size
        self._items: list[tuple[str, str | UploadFile]] = []
        self._is_complete = False
        self._name, self._value = bytearray(), bytearray()  # of the current header
        self._headers: list[tuple[bytes, bytes]] = []
        self._part = ""
        self._file: UploadFile | None = None
        self._data = bytearray()  # of the part, as far as it is not in its file yet
        try:
            self._parser = MultipartParser(
                boundary,
                {
                    "on_part_begin": self._begin,
                    "on_header_field": self._on_name,
                    "on_header_value": self._on_value,
                    "on_header_end": self._end_header,
                    "on_headers_finished": self._end_headers,
                    "on_part_data": self._on_data,
                    "on_part_end": self._end_part,
                    "on_end": self._end,
                },
            )
        except FormParserError as error:
            raise _broken(str(error)) from None

    def feed(self, chunk: bytes) -> None:
        """Parse the next chunk.

        Raises:
            MeshmarkError: ``invalid_request``.
            StoreUnavailableError: the disk cannot be written to.
        """
        with writing():
            try:
                self._parser.write(chunk)
            except FormParserError:
                raise _broken("it is not multipart/form-data as its Content-Type describes it") from None
            self._flush()

    def end(self) -> FormData:
        """Return the whole form, its files rewound."""
        if not self._is_complete:
            raise _broken("it ends before its last boundary")
        with writing():
            for file in self._files():
                file.file.seek(0)
        return FormData(self._items)

    def close(self) -> None:
        """Close the files, which deletes them."""
        for file in self._files():
            with suppress(OSError):  # closing retries a write that failed
                file.file.close()

    def _files(self) -> Iterable[UploadFile]:
        return [value for _, value in self._items if isinstance(value, UploadFile)]

    def _begin(self) -> None:
        self._headers, self._file, self._data = [], None, bytearray()

    def _on_name(self, data: bytes, start: int, end: int) -> None:
        self._name += data[start:end]

    def _on_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _end_header(self) -> None:
        self._headers.append((bytes(self._name).lower(), bytes(self._value)))
        self._name, self._value = bytearray(), bytearray()

    def _end_headers(self) -> None:
        _, options = parse_options_header(dict(self._headers).get(b"content-disposition"))
        if b"name" not in options:
            raise _broken("a part has no name in its Content-Disposition")
        self._part = _text(options[b"name"], "the name of a part")
        if b"filename" in options:
            self._files_left -= 1
            if self._files_left < 0:
                raise _broken("it has too many files")
            filename = _text(options[b"filename"], "the name of a file")
            self._file = UploadFile(self._spool(), filename=filename, headers=Headers(raw=self._headers))
            self._items.append((self._part, self._file))
        else:
            self._fields_left -= 1
            if self._fields_left < 0:
                raise _broken("it has too many fields")

    def _on_data(self, data: bytes, start: int, end: int) -> None:
        self._data += data[start:end]
        most = max(self._max_part_size, LISTS.get(self._part, 0))
        if self._file is None and len(self._data) > most:
            raise _too_long(most)

    def _end_part(self) -> None:
        if self._file is None:
            self._items.append((self._part, _text(self._data, f"the field {self._part[:64]!r}")))
        self._flush()

    def _end(self) -> None:
        self._is_complete = True

    def _flush(self) -> None:
        if self._file is not None and self._data:
            self._file.file.write(self._data)
            self._data = bytearray()


class _Fields:
    """Parser of a form without files (`application/x-www-form-urlencoded`)."""

    def __init__(self, max_fields: float, max_part_size: int) -> None:
        self._max_fields, self._max_part_size = int(max_fields), max_part_size
        self._data = bytearray()

    def feed(self, chunk: bytes) -> None:
        """Buffer the next chunk.

        Raises:
            MeshmarkError: ``invalid_request``.
        """
        self._data += chunk
        if len(self._data) > self._max_fields * self._max_part_size:
            raise _too_long(self._max_part_size)

    def end(self) -> FormData:
        """Return the whole form."""
        if self._data.count(b"&") >= self._max_fields:
            raise _broken("it has too many fields")
        fields: list[tuple[str, str | UploadFile]]
        try:
            fields = [*parse_qsl(self._data.decode(), keep_blank_values=True, errors="strict")]
        except UnicodeDecodeError:
            raise _not_utf_8("a field") from None
        if any(len(str(value)) > self._max_part_size for _, value in fields):
            raise _too_long(self._max_part_size)
        return FormData(fields)

    def close(self) -> None:
        """Do nothing: there is nothing on the disk."""


def _text(data: bytes | bytearray, what: str) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError:
        raise _not_utf_8(what) from None


def _not_utf_8(what: str) -> MeshmarkError:
    return MeshmarkError(ErrorCode.INVALID_REQUEST, f"In the form, {what} is not UTF-8.", HOW_TO_SEND_TEXT)


def _too_long(most: int) -> MeshmarkError:
    return _broken(f"a field has more than {most:,} bytes")


def _broken(trouble: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.INVALID_REQUEST,
        f"The form could not be read: {trouble}.",
        "Send multipart/form-data with the asset as the file part `file` and JSON in the field `params`.",
    )
