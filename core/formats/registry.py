"""Every accepted format as a GLB document."""

from dataclasses import replace

from core.budgets import DEFAULT_BUDGETS, Budgets
from core.formats.archive import Archive
from core.formats.assemble import assemble
from core.formats.assembly import Assembly, dropped
from core.formats.dae import read_dae, read_dae_zip
from core.formats.obj import read_obj_alone
from core.formats.obj_zip import read_obj_zip
from core.formats.off import read_off
from core.formats.pack import pack_archive, pack_json
from core.formats.ply import read_ply, read_ply_zip
from core.formats.sniff import Format, model_in, models_beside
from core.formats.stl import read_stl
from core.formats.threemf import read_3mf
from core.gltf.document import Document
from core.gltf.validate import carried_unread


def to_document(data: bytes, file_format: Format, budgets: Budgets = DEFAULT_BUDGETS) -> Document:
    """The asset as a GLB document; a GLB is taken as it is, a glTF with its files is packed into one.

    OBJ, STL, PLY and OFF become one node with one mesh; 3MF and DAE a node for each thing they draw: see
    :func:`core.formats.assemble.assemble`. Alpha of vertex colours is carried in COLOR_0 and not drawn. What could not
    be carried is in the ``warnings`` of the document.

    Args:
        data: a file that :func:`core.formats.admission.admit` let pass.
        file_format: what it returned.
        budgets: bounds what no header declares: triangles of polygons, instances of instances.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file``, ``no_faces``, ``index_out_of_range``,
            ``non_finite_positions``, ``external_reference``, ``unsupported_feature`` or ``budget_exceeded``.
    """
    if file_format.inner is not file_format:
        return _from_archive(Archive(data, budgets), file_format, budgets)
    match file_format:
        case Format.GLB:
            return _as_it_is(Document.from_glb(data))
        case Format.GLTF:
            return _as_it_is(pack_json(data, budgets))
        case Format.THREEMF:
            return assemble(read_3mf(Archive(data, budgets), budgets))
        case Format.DAE:
            return assemble(read_dae(data, budgets))
        case _:
            return assemble(_read(data, file_format, budgets))


def _from_archive(archive: Archive, file_format: Format, budgets: Budgets) -> Document:
    """The one model of an archive with what belongs to it; that there are others is said."""
    match file_format:
        case Format.GLTF_ZIP:
            document = _as_it_is(pack_archive(archive, budgets))
        case Format.OBJ_ZIP:
            document = assemble(read_obj_zip(archive, budgets))
        case Format.DAE_ZIP:
            document = assemble(read_dae_zip(archive, budgets))
        case Format.PLY_ZIP:
            document = assemble(read_ply_zip(archive, budgets))
        case _:
            document = to_document(archive.read(model_in(archive, file_format)), file_format.inner, budgets)
    if not (others := models_beside(archive, file_format)):
        return document
    read, more = model_in(archive, file_format)[:60], f" and {len(others) - 1:,} more" if len(others) > 1 else ""
    beside = dropped(
        f"The archive holds several models; {read!r} is read, {others[0][:60]!r}{more} not.",
        "Send each model in an archive of its own.",
    )
    return replace(document, warnings=[*document.warnings, beside])


def _as_it_is(document: Document) -> Document:
    return replace(document, warnings=[*document.warnings, *carried_unread(document)])


def _read(data: bytes, file_format: Format, budgets: Budgets) -> Assembly:
    match file_format:
        case Format.OBJ:
            return read_obj_alone(data, budgets)
        case Format.STL:
            return read_stl(data)
        case Format.PLY:
            return read_ply(data, budgets)
        case Format.OFF:
            return read_off(data, budgets)
        case _:
            raise AssertionError(f"{file_format} is not a format of one mesh")
