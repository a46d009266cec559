"""An OBJ in an archive with its MTL and textures."""

from dataclasses import replace
from functools import partial

from core.budgets import Budgets
from core.formats.archive import Archive, outside
from core.formats.assembly import Assembly, dropped
from core.formats.mtl import read_mtl
from core.formats.names import decode
from core.formats.obj import material_libraries, read_alone, read_mesh
from core.formats.polygons import Material
from core.formats.source import Source
from core.formats.textures import IMAGE_ENDINGS, check_pixels, usable_image
from core.notices import Notice


def read_obj(source: Source, _parsed: None, budgets: Budgets) -> Assembly:
    """An OBJ with the materials and textures that came with it, see :func:`core.formats.obj.read_mesh`."""
    if source.archive is None:
        return read_alone(source.data, budgets)
    return read_obj_zip(source.data, source.archive, source.name, budgets)


def read_obj_zip(data: bytes, archive: Archive, name: str, budgets: Budgets) -> Assembly:
    """An OBJ that came in an archive under a ``name``; its materials from the MTL files it names, or from the only one
    there is.

    Textures are looked up by the path in the MTL, then by their bare name anywhere in the archive, since exporters
    write the paths of their own machine. Without any MTL the only image of the archive is the base colour.

    Raises:
        MeshmarkError: as :func:`core.formats.obj.read_mesh`; ``external_reference`` for textures on the network.
    """
    warnings: list[Notice] = []
    materials: dict[bytes, Material] = {}
    libraries = libraries_of(archive, name, data, warnings)
    for library in libraries:
        found, lost = read_mtl(archive.read(library), partial(_load, archive, library))
        materials = found | materials
        warnings += lost
    assembly = read_mesh(data, budgets, materials if libraries else None)
    mesh = assembly.bodies[0]
    if not libraries:
        images = [entry for entry in archive.names if entry.lower().endswith(IMAGE_ENDINGS)]
        if len(images) == 1:
            image = usable_image(images[0], archive.read(images[0]), warnings)
            mesh = replace(mesh, materials=tuple(replace(material, texture=image) for material in mesh.materials))
        elif images:
            warnings.append(
                dropped(
                    f"The archive has {len(images)} images but no MTL that says where they belong; none is used.",
                    "Add the MTL file to the archive.",
                )
            )
    mapped = mesh.attributes.get("TEXCOORD_0")
    if any(material.texture for material in mesh.materials) and (mapped is None or not (mapped.index >= 0).any()):
        warnings.append(dropped("The OBJ has no texture coordinates, so its textures are dropped."))
    check_pixels(mesh.materials, budgets)
    return replace(assembly, bodies=[mesh], warnings=warnings + assembly.warnings)


def libraries_of(archive: Archive, name: str, data: bytes, warnings: list[Notice]) -> list[str]:
    """The names of the MTL files to read; a later one does not override an earlier one."""
    found = []
    for path in material_libraries(data):
        library = _locate(archive, path, name)
        if library is None:
            warnings.append(
                dropped(f"The materials {decode(path)[:60]!r} are not in the archive.", "Add them to the archive.")
            )
        else:
            found.append(library)
    all_there_are = [entry for entry in archive.names if entry.lower().endswith(".mtl")]
    if not found and len(all_there_are) == 1:
        warnings.clear()
        return all_there_are
    return list(dict.fromkeys(found))


def _locate(archive: Archive, path: bytes, beside: str) -> str | None:
    if b"://" in path:
        raise outside(path, beside)
    return archive.locate(path, beside, escaped=False)


def _load(archive: Archive, beside: str, path: bytes) -> bytes | None:
    found = _locate(archive, path, beside)
    return None if found is None else archive.read(found)
