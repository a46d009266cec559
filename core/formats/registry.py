"""The formats, a row for each: how it is recognised, checked, read and written."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from core.budgets import Budgets
from core.choices import FileFormat
from core.errors import ErrorCode, MeshmarkError
from core.formats.assembly import Assembly
from core.formats.dae import check_dae, read_dae
from core.formats.format import Format, Written
from core.formats.marked import Marked
from core.formats.obj import OBJ_SIGNS, check_obj
from core.formats.obj_write import write_obj
from core.formats.obj_zip import read_obj
from core.formats.off import check_off, read_off
from core.formats.off_write import write_off
from core.formats.pack import check_gltf
from core.formats.ply import check_ply, read_ply
from core.formats.ply_write import write_ply
from core.formats.signs import Sign, begins
from core.formats.source import Source
from core.formats.stl import STL_SIGNS, check_stl, read_stl
from core.formats.stl_write import write_stl
from core.formats.threemf import check_3mf, read_3mf
from core.formats.threemf_write import write_3mf
from core.gltf.document import Document
from core.gltf.validate import check_glb

Parsed = TypeVar("Parsed")


@dataclass(frozen=True, kw_only=True)
class FormatSpec(Generic[Parsed]):
    """A format.

    Attributes:
        sniff: signs in the content of a file, each of which tells it.
        part: ending of the part by which a ZIP is this format itself, before any model in it counts; empty for formats
            that are no ZIP.
        named: in an archive a file of this format is taken by its name alone, since its text may start in many ways.
        check: refuses a file by its headers, before anything is allocated for it, and returns the parsed headers.
        read: the content, given these; None where they are the document already.
        write: a marked model in this format; None for GLB, which every result is, and for those that are not written.
    """

    sniff: tuple[Sign, ...] = ()
    part: str = ""
    named: bool = False
    check: Callable[[Source, Budgets], Parsed]
    read: Callable[[Source, Parsed, Budgets], Assembly] | None
    write: Callable[[Marked], Written] | None = None


# In their order they are looked for in archives: those that bring textures along before those that do not.
FORMATS: dict[Format, FormatSpec[Any]] = {
    Format.GLTF: FormatSpec(
        sniff=(begins(rb'\s*\{.{0,3900}?"(?:asset|scenes|nodes|meshes|accessors|buffers|bufferViews)"\s*:'),),
        named=True,
        check=check_gltf,
        read=None,
    ),
    Format.OBJ: FormatSpec(sniff=OBJ_SIGNS, named=True, check=check_obj, read=read_obj, write=write_obj),
    Format.DAE: FormatSpec(
        sniff=(begins(rb"\s*(?:<\?xml.{0,2000}?)?<(?:\w+:)?COLLADA\b"),), named=True, check=check_dae, read=read_dae
    ),
    Format.GLB: FormatSpec[Document](
        sniff=(begins(rb"glTF"),),
        check=lambda source, budgets: check_glb(source.data, budgets),
        read=None,
    ),
    Format.PLY: FormatSpec(sniff=(begins(rb"ply[ \t]*[\r\n]"),), check=check_ply, read=read_ply, write=write_ply),
    Format.THREEMF: FormatSpec(part=".model", check=check_3mf, read=read_3mf, write=write_3mf),
    Format.OFF: FormatSpec(
        sniff=(begins(rb"(?:\s|#[^\n]*\n)*(?:ST)?C?N?4?n?OFF\b"),), check=check_off, read=read_off, write=write_off
    ),
    Format.STL: FormatSpec(sniff=STL_SIGNS, check=check_stl, read=read_stl, write=write_stl),
}

WRITERS = {each: spec.write for each, spec in FORMATS.items() if spec.write is not None}


def export_format(asked: FileFormat, came: Format) -> Format | None:
    """The format to export to beside the GLB; None where that is all that was asked for.

    Args:
        asked: by the request.
        came: of the upload.

    Raises:
        MeshmarkError: ``unsupported_format`` where the upload's own format is asked for, and is not written.
    """
    if asked is FileFormat.GLB or (asked is FileFormat.SAME and came.inner in (Format.GLB, Format.GLTF)):
        return None
    wanted = came.inner if asked is FileFormat.SAME else Format(asked)
    if wanted not in WRITERS:
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FORMAT,
            f"The request asks for the format that the file came in, but {wanted.upper()} is not written.",
            f"Ask for one that is ({', '.join(WRITERS)}), or take the GLB and leave `format` out.",
        )
    return wanted
