"""The admission gate: what a file is and what it declares, before any loader allocates for it."""

from core.budgets import DEFAULT_BUDGETS, Budgets, within
from core.errors import ErrorCode, MeshmarkError
from core.formats import off, ply, stl
from core.formats.archive import Archive
from core.formats.dae_scan import Scan
from core.formats.pack import pack_archive, pack_json
from core.formats.sniff import Format, model_in, sniff
from core.formats.text import count_lines
from core.formats.xml import check_xml, count_elements
from core.gltf.validate import check_document, check_glb
from core.refusals import malformed, no_faces, truncated


def admit(data: bytes, budgets: Budgets = DEFAULT_BUDGETS) -> Format:
    """Recognise a file by its content and refuse it where its headers cannot be true or exceed a budget.

    Only headers are read: whether positions are finite and vertex indices in range is left to the loaders, which
    raise ``non_finite_positions`` and ``index_out_of_range``.

    Args:
        data: the whole file.
        budgets: what it may declare.

    Returns:
        The format to hand to :func:`core.formats.registry.to_document`.

    Raises:
        MeshmarkError: ``empty_file``, ``unknown_format``, ``unsupported_format``, ``unsupported_feature``,
            ``malformed_file``, ``truncated_file``, ``no_faces``, ``index_out_of_range``, ``budget_exceeded`` or
            ``external_reference``.
    """
    if not data:
        raise MeshmarkError(ErrorCode.EMPTY_FILE, "The file is empty: it has 0 bytes.", "Upload the file again.")
    within(len(data), budgets.bytes, "bytes")
    file_format = sniff(data, budgets)
    if file_format is Format.GLTF_ZIP:
        check_document(pack_archive(Archive(data, budgets), budgets), budgets)
    elif file_format.inner is not file_format:
        _check_archive(Archive(data, budgets), file_format, budgets)
    else:
        _check(data, file_format, budgets)
    return file_format


def _check_archive(archive: Archive, file_format: Format, budgets: Budgets) -> None:
    name = model_in(archive, file_format)
    content = archive.read(name)
    if file_format not in (Format.OBJ_ZIP, Format.DAE_ZIP):  # binary ones, which are not taken by their name
        within(len(content), budgets.bytes, "bytes of the model in the archive")
        if not content or (found := sniff(content, budgets)) is not file_format.inner:
            what = f"a file of the kind {found}" if content else "empty"
            raise malformed(f"{name[:60]!r} in the ZIP archive is not what its name says: it is {what}.")
    _check(content, file_format.inner, budgets)


def _check(data: bytes, file_format: Format, budgets: Budgets) -> None:
    """Check a model that is in no archive, or out of it."""
    match file_format:
        case Format.GLB:
            check_glb(data, budgets)
        case Format.GLTF:
            check_document(pack_json(data, budgets), budgets)
        case Format.OBJ:
            _check_obj(data, budgets)
        case Format.THREEMF:
            _check_3mf(Archive(data, budgets), budgets)
        case Format.DAE:
            _check_dae(data, budgets)
        case Format.STL:
            _check_stl(data, budgets)
        case Format.PLY:
            _check_ply(data, budgets)
        case Format.OFF:
            _check_off(data, budgets)


def _check_obj(data: bytes, budgets: Budgets) -> None:
    vertices, faces = count_lines(data, b"vf")
    if faces == 0:
        raise no_faces(f"The OBJ has {vertices:,} vertices but no face.")
    if vertices == 0:
        raise malformed(f"The OBJ has {faces:,} faces but no vertex.")
    within(vertices, budgets.vertices, "vertices")
    within(faces, budgets.faces, "faces")


def _check_stl(data: bytes, budgets: Budgets) -> None:
    if stl.is_ascii(data):
        faces = data.lower().count(b"endfacet")
    else:
        faces = stl.triangle_count(data)
        present = len(data) - stl.HEADER_BYTES
        if present < faces * stl.TRIANGLE_BYTES:
            raise truncated(
                f"The STL claims {faces:,} triangles, which take {faces * stl.TRIANGLE_BYTES:,} bytes, "
                f"but {present:,} follow its header."
            )
        # a few stray bytes at the end are common and harmless
        if present > max(2 * faces, 1) * stl.TRIANGLE_BYTES:
            raise malformed(f"The STL claims {faces:,} triangles, but {present:,} bytes follow its header.")
    if faces == 0:
        raise no_faces("The STL has no triangle.")
    within(faces, budgets.faces, "triangles")


def _check_ply(data: bytes, budgets: Budgets) -> None:
    header = ply.parse_header(data)
    vertex, surface = header.element("vertex"), header.surface
    if vertex is None or not set("xyz") <= {column.name for column in vertex.properties if not column.count_kind}:
        raise malformed("The PLY declares no vertices with x, y and z.")
    if surface is None:
        raise no_faces(f"The PLY has {vertex.count:,} vertices but no face.")
    if not any(column.name in ply.FACE_LISTS and column.count_kind for column in surface.properties):
        raise malformed("The faces of the PLY have no list of vertex indices.")
    for element in header.elements:
        names = [column.name for column in element.properties]
        if len(set(names)) != len(names):
            raise malformed(f"The PLY declares a property of {element.name} twice.")
    if len({element.name for element in header.elements}) != len(header.elements):
        raise malformed("The PLY declares an element twice.")
    within(vertex.count, budgets.vertices, "vertices")
    within(surface.count, budgets.faces, "faces")
    # in a text every number takes at least a digit and a blank
    least = sum(
        element.count * (2 * len(element.properties) if header.format == "ascii" else element.least_row_bytes)
        for element in header.elements
    )
    present = len(data) - header.end + (header.format == "ascii")  # the last blank may be missing
    if least > present:
        raise truncated(f"What the PLY declares takes at least {least:,} bytes, but {present:,} follow its header.")


def _check_3mf(archive: Archive, budgets: Budgets) -> None:
    """Parts may write their elements with a prefix: then only the loader counts them."""
    vertices = triangles = elements = 0
    for name in archive.names:
        if name.lower().endswith(".model"):
            part = archive.read(name)
            check_xml(part, f"The 3MF model {name[:60]!r}")
            vertices += part.count(b"<vertex ")
            triangles += part.count(b"<triangle ")
            elements += count_elements(part)
    within(vertices, budgets.vertices, "vertices")
    within(triangles, budgets.faces, "triangles")
    within(elements, budgets.vertices + budgets.faces + budgets.xml_elements, "XML elements")


def _check_dae(data: bytes, budgets: Budgets) -> None:
    scan = Scan(data, budgets)
    if scan.drawn == 0:
        raise no_faces(scan.why_nothing_is_drawn)


def _check_off(data: bytes, budgets: Budgets) -> None:
    header = off.parse_header(data)
    if header.faces == 0:
        raise no_faces(f"The OFF has {header.vertices:,} vertices but no face.")
    within(header.vertices, budgets.vertices, "vertices")
    within(header.faces, budgets.faces, "faces")
    if header.least_bytes > len(data) - header.end:
        raise truncated(
            f"The OFF declares {header.vertices:,} vertices and {header.faces:,} faces, "
            f"but {len(data) - header.end:,} bytes follow its header."
        )
