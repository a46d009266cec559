"""Every accepted format as a GLB document."""

from dataclasses import replace

from core.asset.archive import Archive
from core.asset.assemble import assemble
from core.asset.assembly import Assembly
from core.asset.budgets import DEFAULT_BUDGETS, Budgets
from core.asset.dae import read_dae, read_dae_zip
from core.asset.glb_check import carried_unread
from core.asset.gltf import Document
from core.asset.obj import read_obj_alone
from core.asset.obj_zip import read_obj_zip
from core.asset.off import read_off
from core.asset.pack import pack_archive, pack_json
from core.asset.ply import read_ply
from core.asset.sniff import Format
from core.asset.stl import read_stl
from core.asset.threemf import read_3mf


def to_document(data: bytes, file_format: Format, budgets: Budgets = DEFAULT_BUDGETS) -> Document:
    """The asset as a GLB document; a GLB is taken as it is, a glTF with its files is packed into one.

    OBJ, STL, PLY and OFF become one node with one mesh; 3MF and DAE a node for each thing they draw: see
    :func:`core.asset.assemble.assemble`. Alpha of vertex colours is carried in COLOR_0 and not drawn. What could not
    be carried is in the ``warnings`` of the document.

    Args:
        data: a file that :func:`core.asset.gate.admit` let pass.
        file_format: what it returned.
        budgets: bounds what no header declares: triangles of polygons, instances of instances.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file``, ``no_faces``, ``index_out_of_range``,
            ``non_finite_positions``, ``external_reference``, ``unsupported_feature`` or ``budget_exceeded``.
    """
    match file_format:
        case Format.GLB:
            return _as_it_is(Document.from_glb(data))
        case Format.GLTF:
            return _as_it_is(pack_json(data, budgets))
        case Format.GLTF_ZIP:
            return _as_it_is(pack_archive(Archive(data, budgets), budgets))
        case Format.OBJ_ZIP:
            return assemble(read_obj_zip(Archive(data, budgets), budgets))
        case Format.THREEMF:
            return assemble(read_3mf(Archive(data, budgets), budgets))
        case Format.DAE:
            return assemble(read_dae(data, budgets))
        case Format.DAE_ZIP:
            return assemble(read_dae_zip(Archive(data, budgets), budgets))
        case _:
            return assemble(_read(data, file_format, budgets))


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
