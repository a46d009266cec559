"""The admission gate: the format of a file and its declarations, before a loader allocates for it; and the reading."""

from dataclasses import dataclass, replace
from typing import Any

from core.budgets import DEFAULT_BUDGETS, Budgets, within
from core.errors import ErrorCode, MeshmarkError
from core.formats.archive import Archive
from core.formats.assemble import assemble
from core.formats.assembly import dropped
from core.formats.format import Format
from core.formats.registry import FORMATS
from core.formats.sniff import model_in, models_beside, sniff
from core.formats.source import Source
from core.gltf.document import Document
from core.notices import Notice
from core.refusals import malformed


@dataclass(frozen=True, eq=False)
class Admitted:
    """A file that may be read.

    Attributes:
        format: by its content.
        source: the model, out of its archive.
        parsed: of the model, by the check of its format.
    """

    format: Format
    source: Source
    parsed: Any


def admit(data: bytes, budgets: Budgets = DEFAULT_BUDGETS) -> Admitted:
    """Recognise a file by its content and refuse it where its headers cannot be true or exceed a budget.

    Only headers are read: whether positions are finite and vertex indices in range is left to :func:`document_of`.

    Args:
        data: the whole file.
        budgets: bounds its declarations.

    Raises:
        MeshmarkError: ``empty_file``, ``unknown_format``, ``unsupported_format``, ``unsupported_feature``,
            ``malformed_file``, ``truncated_file``, ``no_faces``, ``index_out_of_range``, ``budget_exceeded`` or
            ``external_reference``.
    """
    if not data:
        raise MeshmarkError(ErrorCode.EMPTY_FILE, "The file is empty: it has 0 bytes.", "Upload the file again.")
    within(len(data), budgets.bytes, "bytes")
    file_format = sniff(data, budgets)
    source = Source(data)
    if file_format.inner is not file_format:
        source = _unpacked(Archive(data, budgets), file_format, budgets)
    return Admitted(file_format, source, FORMATS[file_format.inner].check(source, budgets))


def document_of(admitted: Admitted, budgets: Budgets = DEFAULT_BUDGETS) -> Document:
    """The asset as a GLB document; a GLB is taken as it is, a glTF with its files is packed into one.

    OBJ, STL, PLY and OFF become one node with one mesh; 3MF and DAE a node for each body they draw: see
    :func:`core.formats.assemble.assemble`. Alpha of vertex colours is carried in COLOR_0 and not drawn. Losses are in
    the ``warnings`` of the document.

    Args:
        admitted: a file that :func:`admit` let pass.
        budgets: bounds also undeclared counts: triangles of polygons, instances of instances.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file``, ``no_faces``, ``index_out_of_range``,
            ``non_finite_positions``, ``external_reference``, ``unsupported_feature`` or ``budget_exceeded``.
    """
    spec, source, parsed = FORMATS[admitted.format.inner], admitted.source, admitted.parsed
    if spec.read is None:
        document: Document = replace(parsed, warnings=[*parsed.warnings, *_carried_unread(parsed)])
    else:
        document = assemble(spec.read(source, parsed, budgets))
    if source.archive is None or not (others := models_beside(source.archive, admitted.format)):
        return document
    more = f" and {len(others) - 1:,} more" if len(others) > 1 else ""
    beside = dropped(
        f"The archive holds several models; {source.name[:60]!r} is read, {others[0][:60]!r}{more} not.",
        "Send each model in an archive of its own.",
    )
    return replace(document, warnings=[*document.warnings, beside])


def _unpacked(archive: Archive, file_format: Format, budgets: Budgets) -> Source:
    """The one model of an archive."""
    name = model_in(archive, file_format)
    content = archive.read(name)
    if not FORMATS[file_format.inner].named:
        within(len(content), budgets.bytes, "bytes of the model in the archive")
        if not content or (found := sniff(content, budgets)) is not file_format.inner:
            what = f"a file of the kind {found}" if content else "empty"
            raise malformed(f"{name[:60]!r} in the ZIP archive is not what its name says: it is {what}.")
    return Source(content, archive, name)


def _carried_unread(document: Document) -> list[Notice]:
    """A warning for each part of a sound document that is carried unread; for images see
    :func:`core.gltf.textures.undecoded_textures`."""
    warnings = []
    if document.chunks:
        listed = ", ".join(repr(kind.decode("latin-1").rstrip("\0 ")) for kind, _ in document.chunks[:3])
        warnings.append(
            Notice(
                ErrorCode.UNSUPPORTED_FEATURE,
                f"The GLB has further chunks ({listed}), which are carried as they are; nobody looked what is in them.",
                "Take them out before the upload if they hold what nobody shall have unmarked.",
            )
        )
    return warnings
