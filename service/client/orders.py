"""Orders for jobs, as their fields are named over HTTP, and the forms that carry them."""

import json
import os
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Literal, NotRequired, TypedDict

File = str | os.PathLike[str] | bytes  # a path, or the content itself
Region = dict[str, Any]  # {"node": ...}, {"material": ...} or {"box": {"min": ..., "max": ...}}
FormFile = tuple[str, Any]  # its name, and its bytes or an open file
FORM_FIELDS = ("metadata", "webhook", "priority", "copies")
OF_WATERMARKS = (*FORM_FIELDS, "logo", "font", "cache")


@dataclass(frozen=True)
class UploadId:
    """Asset that was sent ahead."""

    id: str


@dataclass(frozen=True)
class SourceUrl:
    """Asset that the service fetches from an address, where its operator allows that."""

    url: str


Source = File | UploadId | SourceUrl


class PreviewModel(TypedDict, total=False):
    """Limits of a light model for public display."""

    triangles: int
    texture: int
    alone: bool


class Marking(TypedDict, total=False):
    """Parameters of a watermark but its text: the manual's page on parameters has each."""

    label: Literal["cn", "eu", "us-ca", "kr", "in", "custom"]
    declaration: dict[str, Any]
    metadata_only: bool
    qr: str
    logo_position: Literal["left", "above"]
    wrap: Literal["auto", "none"]
    align: Literal["left", "center", "right"]
    line_spacing: float
    letter_spacing: float
    direction: Literal["horizontal", "vertical", "auto"]
    language: str
    preset: Literal["merchandise", "provenance", "paper"]
    strength: Literal["discreet", "standard", "strong"]
    mode: Literal["emboss", "deboss"]
    profile: Literal["soft", "flat"]
    size: float
    size_exact: bool
    relief: float
    count: int
    color: str | list[str]
    seed: int
    keep_out: list[Region]
    prefer: list[Region]
    solver: Literal["levenberg-marquardt", "adam"]
    unmarked_copies: Literal["leave_out", "keep"]
    format: Literal["glb", "same", "stl", "obj", "ply", "3mf"]
    evaluate: Literal["full", "geometry", "none"]
    explain: bool
    turntable: bool
    preview_model: PreviewModel


class Sending(TypedDict, total=False):
    """Fields that go with an asset of any kind of job."""

    metadata: Mapping[str, str]
    webhook: str
    priority: Literal["high", "normal", "low"]


class Copy(TypedDict):
    """A copy of an asset with a text of its own."""

    text: str
    metadata: NotRequired[Mapping[str, str]]


class Order(Marking, Sending, total=False):
    """Everything that goes with an asset to be watermarked, but its text."""

    logo: File
    font: File
    cache: bool
    copies: Sequence[Copy]


class Parameters(Marking, total=False):
    """Parameters of a watermark."""

    text: str


class BatchItem(TypedDict):
    """One job of a batch; it has either an `upload_id` or a `source_url`."""

    parameters: Parameters
    upload_id: NotRequired[str]
    source_url: NotRequired[str]
    metadata: NotRequired[Mapping[str, str]]
    priority: NotRequired[Literal["high", "normal", "low"]]
    webhook: NotRequired[str]
    idempotency_key: NotRequired[str]
    cache: NotRequired[bool]
    copies: NotRequired[Sequence[Copy]]


@dataclass(frozen=True)
class Form:
    """Form of a request: `params` as JSON, if it has any, text fields, files by their part, and the query."""

    params: dict[str, Any] | None
    files: dict[str, tuple[str, File]]
    fields: Mapping[str, Any] = field(default_factory=dict)
    query: dict[str, str] = field(default_factory=dict)

    def data(self) -> dict[str, str]:
        """The text fields, written as the service reads them."""
        texts = {name: value if isinstance(value, str) else json.dumps(value) for name, value in self.fields.items()}
        return texts if self.params is None else {"params": json.dumps(self.params), **texts}

    @contextmanager
    def opened(self) -> Iterator[dict[str, FormFile]]:
        """The files by their part, those at paths opened at their beginning.

        Raises:
            OSError: one cannot be opened.
        """
        with ExitStack() as stack:
            yield {part: (name, stack.enter_context(opened(content))) for part, (name, content) in self.files.items()}


def opened(content: File) -> AbstractContextManager[bytes | BinaryIO]:
    """Content itself, or the file at a path opened at its beginning.

    Raises:
        OSError: it cannot be opened.
    """
    return nullcontext(content) if isinstance(content, bytes) else Path(content).open("rb")


def watermark_form(asset: Source, text: str | None, filename: str | None, order: Order) -> Form:
    """The form that orders a watermark."""
    params = {name: value for name, value in order.items() if name not in OF_WATERMARKS}
    files: dict[str, Any] = {part: content for part, content in order.items() if part in ("logo", "font")}
    asset_files, asset_fields = _placed(asset, filename)
    return Form(
        params if text is None else {"text": text, **params},
        asset_files | {part: named(content, part) for part, content in files.items()},
        asset_fields | {name: value for name, value in order.items() if name in FORM_FIELDS},
        {} if order.get("cache", True) else {"cache": "false"},
    )


def verification_form(
    suspect: Source, filename: str | None, params: Mapping[str, Any], parts: Mapping[str, File | None], sending: Sending
) -> Form:
    """The form that orders a verification."""
    files = {part: named(content, part) for part, content in parts.items() if content is not None}
    given = {name: value for name, value in params.items() if value is not None}
    asset_files, asset_fields = _placed(suspect, filename)
    return Form(given, asset_files | files, {**asset_fields, **sending})


def conversion_form(asset: File, filename: str | None) -> Form:
    """The form that orders a conversion."""
    return Form(None, {"file": named(asset, filename)})


def _placed(asset: Source, filename: str | None) -> tuple[dict[str, tuple[str, File]], dict[str, Any]]:
    """The files and the text fields of a form that say which asset it is."""
    match asset:
        case UploadId(given):
            return {}, {"upload_id": given}
        case SourceUrl(given):
            return {}, {"source_url": given}
        case _:
            return {"file": named(asset, filename)}, {}


def named(content: File, filename: str | None) -> tuple[str, File]:
    """A file with its name: the given one, else that of its path."""
    if isinstance(content, bytes):
        return filename or "asset", content
    return filename or Path(content).name, content


def new_key() -> str:
    """An idempotency key that no other request has."""
    return str(uuid.uuid4())
