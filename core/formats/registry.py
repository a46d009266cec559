"""The formats that are read, a row for each."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from core.budgets import Budgets
from core.formats.assembly import Assembly
from core.formats.dae import check_dae, read_dae
from core.formats.obj import check_obj
from core.formats.obj_zip import read_obj
from core.formats.off import check_off, read_off
from core.formats.pack import check_gltf
from core.formats.ply import check_ply, read_ply
from core.formats.sniff import Format
from core.formats.source import Source
from core.formats.stl import check_stl, read_stl
from core.formats.threemf import check_3mf, read_3mf
from core.gltf.document import Document
from core.gltf.validate import check_glb

Parsed = TypeVar("Parsed")


@dataclass(frozen=True)
class FormatSpec(Generic[Parsed]):
    """A format.

    Attributes:
        check: refuses a file by its headers, before anything is allocated for it, and returns the parsed headers.
        read: the content, given these; None where they are the document already.
    """

    check: Callable[[Source, Budgets], Parsed]
    read: Callable[[Source, Parsed, Budgets], Assembly] | None


FORMATS: dict[Format, FormatSpec[Any]] = {
    Format.GLB: FormatSpec[Document](lambda source, budgets: check_glb(source.data, budgets), None),
    Format.GLTF: FormatSpec(check_gltf, None),
    Format.OBJ: FormatSpec(check_obj, read_obj),
    Format.STL: FormatSpec(check_stl, read_stl),
    Format.PLY: FormatSpec(check_ply, read_ply),
    Format.OFF: FormatSpec(check_off, read_off),
    Format.THREEMF: FormatSpec(check_3mf, read_3mf),
    Format.DAE: FormatSpec(check_dae, read_dae),
}
