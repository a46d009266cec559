"""The gate of a GLB: every declaration that will be read is of the right type, consistent and within budget."""

import re
from urllib.parse import unquote, urlsplit

import numpy as np

from core.budgets import Budgets, within
from core.errors import ErrorCode, MeshmarkError
from core.gltf.compression import meshopt_of
from core.gltf.data_uri import is_data_uri
from core.gltf.declarations import Json, entries, integer, mapping, numbers, quote, reference, references
from core.gltf.document import COMPONENT_TYPES, ELEMENT_TYPES, Document, malformed
from core.gltf.hierarchy import scene_nodes
from core.gltf.images import image_size
from core.gltf.validate_compression import check_draco, check_fallback, check_meshopt
from core.refusals import no_faces, truncated

MAX_JSON_DEPTH = 64
TRIANGLES, TRIANGLE_FAN = 4, 6

# Extensions that change nothing about where the surface is, or that are read or carried as they are.
UNDERSTOOD = re.compile(
    r"KHR_mesh_quantization|KHR_texture_(transform|basisu)|KHR_materials_\w+|KHR_lights_\w+|KHR_animation_pointer"
    r"|KHR_(draco_mesh|meshopt)_compression|EXT_meshopt_compression|KHR_xmp\w*|KHR_node_\w+|EXT_texture_webp|EXT_mesh_gpu_instancing|EXT_lights_\w+|EXT_materials_\w+|MSFT_lod"
)
UNREAD_IMAGES = ("EXT_texture_avif", "MSFT_texture_dds")
_ARRAYS = (
    *("accessors", "animations", "bufferViews", "buffers", "cameras", "images", "materials", "meshes", "nodes"),
    *("samplers", "scenes", "skins", "textures"),
)
_NODE_NUMBERS = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3}


def check_glb(data: bytes, budgets: Budgets) -> Document:
    """Refuse a GLB whose declarations contradict each other, its bytes or the budgets.

    Returns:
        Its content.

    Raises:
        MeshmarkError: ``truncated_file``, ``malformed_file``, ``budget_exceeded``, ``external_reference``,
            ``unsupported_format``, ``unsupported_feature`` or ``no_faces``.
    """
    if len(data) >= 12 and int.from_bytes(data[4:8], "little") == 1:
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FORMAT, "The file is a GLB of version 1, not 2.", "Export it as a glTF 2.0 GLB."
        )
    check_json_text(data[20 : 20 + int.from_bytes(data[12:16], "little")], budgets)
    document = Document.from_glb(data)
    check_document(document, budgets)
    return document


def check_document(document: Document, budgets: Budgets) -> None:
    """Refuse a document whose declarations contradict each other, its bytes or the budgets.

    Raises:
        MeshmarkError: as :func:`check_glb`.
    """
    json = document.json
    check_version(json)
    for kind in _ARRAYS:
        values = json.get(kind, [])
        if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
            raise malformed(f"{kind} of the GLB is not an array of objects.")
    _check_extensions(json)
    buffers = _buffers(document)
    _check_views(json, buffers, budgets)
    _check_accessors(json, budgets)
    _check_images(document, budgets)
    _check_skins(json)
    _check_animations(json)
    drawn = [_mesh_counts(json, number) for number in range(len(entries(json, "meshes")))]
    faces = vertices = primitives = 0
    for mesh, draws in _draws(document):
        faces += drawn[mesh][0] * draws
        vertices += drawn[mesh][1] * draws
        primitives += len(json["meshes"][mesh]["primitives"]) * draws
    if faces == 0:
        raise no_faces(f"The scene of the GLB draws no triangle ({len(drawn):,} meshes in the file).")
    within(faces, budgets.faces, "triangles")
    within(vertices, budgets.vertices, "vertices")
    within(primitives, budgets.draws, "mesh primitives to draw")


def check_json_text(text: bytes, budgets: Budgets) -> None:
    """Bound what the JSON costs before it is parsed; a data URI costs no more than its length.

    Raises:
        MeshmarkError: ``budget_exceeded`` or ``malformed_file``.
    """
    bare = re.sub(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"', b'""', text, flags=re.DOTALL)
    within(len(bare), budgets.json_bytes, "bytes of JSON beside its texts")
    brackets = bare.translate(None, bytes(set(range(256)) - set(b"[]{}")))
    within(brackets.count(b"[") + brackets.count(b"{"), budgets.json_values, "JSON arrays and objects")
    steps = np.where(np.isin(np.frombuffer(brackets, np.uint8), tuple(b"[{")), 1, -1)
    depth = int(np.cumsum(steps).max(initial=0))
    if depth > MAX_JSON_DEPTH:
        raise malformed(f"The JSON of the GLB is nested {depth:,} deep; {MAX_JSON_DEPTH} is the most accepted.")


def check_version(json: Json) -> None:
    """Refuse a glTF of another version than 2; one that gives its version as a number is read all the same.

    Raises:
        MeshmarkError: ``unsupported_format``, or ``malformed_file`` where there is no version.
    """
    asset = mapping(json, "asset", "glTF")
    wanted = asset.get("minVersion", asset.get("version"))
    if wanted is None and any(isinstance(json.get(kind), dict) for kind in _ARRAYS):
        wanted = "1.0"  # its objects are kept by name, and it need not declare its version
    if isinstance(wanted, bool) or not isinstance(wanted, str | int | float):
        raise malformed("asset.version of the GLB is missing.")
    number = str(wanted)
    if number not in ("2", "2.0") and not (number.startswith("2.") and "minVersion" not in asset):
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FORMAT,
            f"The file asks for glTF {quote(wanted)}; 2.0 is read.",
            "Export it as a glTF 2.0 GLB.",
        )


def _check_extensions(json: Json) -> None:
    for kind in ("extensionsUsed", "extensionsRequired"):
        names = json.get(kind, [])
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise malformed(f"{kind} of the GLB is not an array of names.")
    required = json.get("extensionsRequired", [])
    unknown = [name for name in required if not UNDERSTOOD.fullmatch(name) and not _has_fallback(json, name)]
    if unknown:
        listed = ", ".join(quote(name) for name in unknown[:10])
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FEATURE,
            f"The GLB requires {listed}, which this release does not read.",
            "Export the asset without these extensions and send it again.",
        )


def _has_fallback(json: Json, extension: str) -> bool:
    """True where all textures with an image of a kind that is not read have another one beside it."""
    textures = [
        texture for texture in entries(json, "textures") if extension in mapping(texture, "extensions", "texture")
    ]
    return extension in UNREAD_IMAGES and all("source" in texture for texture in textures)


def _buffers(document: Document) -> list[bytes]:
    """The bytes of each buffer, data URIs decoded once."""
    buffers = []
    for number, buffer in enumerate(entries(document.json, "buffers")):
        where = f"buffers[{number}]"
        declared = integer(buffer, "byteLength", where, least=1)
        if check_fallback(buffer, number):
            buffers.append(b"")
            continue
        buffers.append(document.buffer(number))
        if declared > len(buffers[-1]):
            raise truncated(f"{where} declares {declared:,} bytes, but the file holds {len(buffers[-1]):,} of them.")
    return buffers


def _check_views(json: Json, buffers: list[bytes], budgets: Budgets) -> None:
    decoded = 0
    for number, view in enumerate(entries(json, "bufferViews")):
        where = f"bufferViews[{number}]"
        buffer = reference(view.get("buffer"), json, "buffers", where)
        end = integer(view, "byteOffset", where, 0) + integer(view, "byteLength", where, least=1)
        length = entries(json, "buffers")[buffer]["byteLength"]
        if end > length:
            raise malformed(f"{where} ends at byte {end:,} of buffers[{buffer}], which has {length:,}.")
        mapping(view, "extensions", where)
        if meshopt_of(view) is not None:
            decoded += check_meshopt(view, json, buffers, where)
        elif not buffers[buffer]:
            raise malformed(f"{where} is not compressed, but its bytes are in buffers[{buffer}], which has none.")
        if "byteStride" in view and not 4 <= integer(view, "byteStride", where) <= 252:
            raise malformed(f"{where}.byteStride is {view['byteStride']}, not between 4 and 252.")
    within(decoded, budgets.bytes, "bytes of decoded buffer views")


def _check_accessors(json: Json, budgets: Budgets) -> None:
    total = 0
    for number, accessor in enumerate(entries(json, "accessors")):
        where = f"accessors[{number}]"
        component, element = accessor.get("componentType"), accessor.get("type")
        if type(component) is not int or component not in COMPONENT_TYPES:
            raise malformed(f"{where}.componentType is {quote(component)}, which glTF does not know.")
        if not isinstance(element, str) or element not in ELEMENT_TYPES:
            raise malformed(f"{where}.type is {quote(element)}, which glTF does not know.")
        if not isinstance(accessor.get("normalized", False), bool):
            raise malformed(f"{where}.normalized is not true or false.")
        count = integer(accessor, "count", where, least=1)
        # a triangle list has three indices a face: this is the only count that may exceed the vertices
        within(count, max(budgets.vertices, 3 * budgets.faces), f"elements in {where}")
        if "bufferView" in accessor:
            _check_fit(json, accessor, count, component, element, where)
        if "sparse" in accessor:
            total += _check_sparse(json, accessor, count, component, element, where)
        total += count * _element_bytes(component, element)
    # accessors without a buffer view cost memory all the same, and so do many accessors over one buffer view
    within(total, budgets.bytes, "bytes of accessor values")


def _element_bytes(component: int, element: str) -> int:
    """Bytes from the start of an element to its end; matrix columns start at multiples of 4."""
    columns, rows = ELEMENT_TYPES[element]
    column = rows * COMPONENT_TYPES[component].itemsize
    return column if columns == 1 else (columns - 1) * (-(-column // 4) * 4) + column


def _check_fit(json: Json, part: Json, count: int, component: int, element: str, where: str) -> None:
    view = entries(json, "bufferViews")[reference(part.get("bufferView"), json, "bufferViews", where)]
    size = _element_bytes(component, element)
    stride = view.get("byteStride", size)
    needed = integer(part, "byteOffset", where, 0) + (count - 1) * stride + size
    if needed > view["byteLength"]:
        raise malformed(
            f"{where} declares {count:,} elements, which take {needed:,} bytes of "
            f"bufferViews[{part['bufferView']}], but that has {view['byteLength']:,}."
        )


def _check_sparse(json: Json, accessor: Json, count: int, component: int, element: str, where: str) -> int:
    """Bytes of the substituted values and their indices."""
    sparse = mapping(accessor, "sparse", where)
    where = f"{where}.sparse"
    replaced = integer(sparse, "count", where, least=1)
    if replaced > count:
        raise malformed(f"{where} replaces {replaced:,} of {count:,} elements.")
    indices, values = mapping(sparse, "indices", where), mapping(sparse, "values", where)
    index_type = indices.get("componentType")
    if type(index_type) is not int or index_type not in (5121, 5123, 5125):
        raise malformed(f"{where}.indices.componentType is {quote(index_type)}, not an unsigned integer type.")
    _check_fit(json, indices, replaced, index_type, "SCALAR", f"{where}.indices")
    _check_fit(json, values, replaced, component, element, f"{where}.values")
    return replaced * (_element_bytes(component, element) + COMPONENT_TYPES[index_type].itemsize)


def _check_images(document: Document, budgets: Budgets) -> None:
    """Refuse images of known kinds beyond the budgets; others are carried unread, and cost nothing."""
    pixels = 0
    for number, image in enumerate(entries(document.json, "images")):
        where = f"images[{number}]"
        if is_beside(image):
            continue
        if "bufferView" in image:
            reference(image["bufferView"], document.json, "bufferViews", where)
        elif not isinstance(image.get("uri"), str):
            raise malformed(f"{where} has neither a buffer view nor a URI.")
        elif not is_data_uri(image["uri"]):
            raise MeshmarkError(
                ErrorCode.EXTERNAL_REFERENCE,
                f"{where} lies in another file ({quote(image['uri'])}); nothing outside the uploaded file is opened.",
                "Export the asset as one self-contained GLB with its textures embedded.",
            )
        width, height = image_size(document.image(number) or memoryview(b"")) or (0, 0)
        pixels += width * height
        within(pixels, budgets.image_pixels, f"texture pixels up to {where}, which has {width:,} x {height:,},")


def is_beside(image: Json) -> bool:
    """True where an image of a GLB is a file in or below the GLB's own folder. It is never opened, only carried."""
    uri = image.get("uri")
    if "bufferView" in image or not isinstance(uri, str) or is_data_uri(uri):
        return False
    try:
        parts = urlsplit(uri)
    except ValueError:
        return False
    path = unquote(parts.path).replace("\\", "/")
    return not (parts.scheme or parts.netloc or path.startswith("/") or ".." in path.split("/"))


def _check_skins(json: Json) -> None:
    for number, skin in enumerate(entries(json, "skins")):
        where = f"skins[{number}]"
        references(skin, "joints", json, "nodes", where)
        if "inverseBindMatrices" in skin:
            reference(skin["inverseBindMatrices"], json, "accessors", where)


def _check_animations(json: Json) -> None:
    for number, animation in enumerate(entries(json, "animations")):
        where = f"animations[{number}].samplers"
        samplers = animation.get("samplers", [])
        if not isinstance(samplers, list) or not all(isinstance(sampler, dict) for sampler in samplers):
            raise malformed(f"{where} is not an array of objects.")
        for sampler in samplers:
            for key in ("input", "output"):
                reference(sampler.get(key), json, "accessors", where)


def _mesh_counts(json: Json, number: int) -> tuple[int, int]:
    """Triangles and vertices that drawing a mesh once takes; primitives may share vertices."""
    mesh, where = entries(json, "meshes")[number], f"meshes[{number}]"
    numbers(mesh, "weights", where)
    primitives = mesh.get("primitives")
    if not isinstance(primitives, list) or not all(isinstance(primitive, dict) for primitive in primitives):
        raise malformed(f"{where}.primitives is not an array of objects.")
    triangles, vertices = 0, {}
    for index, primitive in enumerate(primitives):
        corners = _corner_count(json, primitive, f"{where}.primitives[{index}]")
        mode, attributes = primitive.get("mode", TRIANGLES), primitive["attributes"]
        if mode >= TRIANGLES and "POSITION" in attributes:
            triangles += corners // 3 if mode == TRIANGLES else max(corners - 2, 0)
            vertices[str(attributes)] = entries(json, "accessors")[attributes["POSITION"]]["count"]
    return triangles, sum(vertices.values())


def _corner_count(json: Json, primitive: Json, where: str) -> int:
    """Number of vertices that a primitive draws, repetitions counted; its references and types are checked."""
    accessors = entries(json, "accessors")
    if integer(primitive, "mode", where, TRIANGLES) > TRIANGLE_FAN:
        raise malformed(f"{where}.mode is {primitive['mode']}, which glTF does not know.")
    if "material" in primitive:
        reference(primitive["material"], json, "materials", where)
    targets = primitive.get("targets", [])
    if not isinstance(targets, list) or not all(isinstance(target, dict) for target in targets):
        raise malformed(f"{where}.targets is not an array of objects.")
    if not isinstance(primitive.get("attributes"), dict):
        raise malformed(f"{where} has no attributes.")
    counts = set()
    for attributes in (primitive["attributes"], *targets):
        for name, number in attributes.items():
            accessor = accessors[reference(number, json, "accessors", f"{where}, attribute {quote(name)}")]
            counts.add(accessor["count"])
            if name == "POSITION" and accessor["type"] != "VEC3":
                raise malformed(f"The positions of {where} are not three-dimensional.")
    check_draco(primitive, json, where)
    if len(counts) > 1:
        raise malformed(f"The attributes of {where} differ in length: from {min(counts):,} to {max(counts):,}.")
    if "indices" not in primitive:
        return max(counts, default=0)
    indices = accessors[reference(primitive["indices"], json, "accessors", f"{where}.indices")]
    if indices["type"] != "SCALAR" or COMPONENT_TYPES[indices["componentType"]].kind != "u":
        raise malformed(f"The indices of {where} are not unsigned integers.")
    return int(indices["count"])


def _draws(document: Document) -> list[tuple[int, int]]:
    """(mesh, number of draws) for each node that the scene draws.

    Raises:
        MeshmarkError: ``malformed_file`` where the nodes are not a forest.
    """
    json = document.json
    nodes = entries(json, "nodes")
    children = [_checked_node(json, number) for number in range(len(nodes))]
    parents = [0] * len(nodes)
    for child in (child for family in children for child in family):
        parents[child] += 1
        if parents[child] > 1:
            raise malformed(f"nodes[{child}] has two parents; the nodes of a glTF are trees.")
    reached = [number for number, count in enumerate(parents) if count == 0]
    for number in reached:  # grows while it is walked
        reached.extend(children[number])
    if len(reached) < len(nodes):
        raise malformed("The nodes of the GLB form a circle.")
    for number, scene in enumerate(entries(json, "scenes")):
        references(scene, "nodes", json, "nodes", f"scenes[{number}]")
    drawn = [nodes[number] for number in scene_nodes(document)]
    return [(node["mesh"], _instances(json, node)) for node in drawn if "mesh" in node]


def _checked_node(json: Json, number: int) -> list[int]:
    """The children of a node whose other properties are of the right type."""
    node, where = entries(json, "nodes")[number], f"nodes[{number}]"
    if "mesh" in node:
        reference(node["mesh"], json, "meshes", where)
    if "skin" in node:
        reference(node["skin"], json, "skins", where)
    for key, count in _NODE_NUMBERS.items():
        numbers(node, key, where, count)
    numbers(node, "weights", where)
    mapping(node, "extensions", where)
    return references(node, "children", json, "nodes", where)


def _instances(json: Json, node: Json) -> int:
    """Number of times that a node draws its mesh (EXT_mesh_gpu_instancing)."""
    extension = mapping(node.get("extensions", {}), "EXT_mesh_gpu_instancing", "node")
    attributes = mapping(extension, "attributes", "EXT_mesh_gpu_instancing")
    numbers = [reference(value, json, "accessors", "EXT_mesh_gpu_instancing") for value in attributes.values()]
    return max((entries(json, "accessors")[number]["count"] for number in numbers), default=1)
