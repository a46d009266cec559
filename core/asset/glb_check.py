"""The gate of a GLB: every declaration that will be read is of the right type, consistent and within budget."""

import base64
import binascii
import re
import sys
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np

from core.asset.budgets import Budgets, within
from core.asset.gltf import COMPONENT_TYPES, COMPRESSED_VIEWS, ELEMENT_TYPES, Document, malformed, unsupported_extension
from core.asset.hierarchy import scene_nodes
from core.asset.images import image_size
from core.asset.refusals import no_faces, truncated
from core.errors import ErrorCode, MeshmarkError

Json = dict[str, Any]

MAX_JSON_DEPTH = 64
TRIANGLES, TRIANGLE_FAN = 4, 6

# Extensions that change nothing about where the surface is, or that are read or carried as they are.
UNDERSTOOD = re.compile(
    r"KHR_mesh_quantization|KHR_texture_(transform|basisu)|KHR_materials_\w+|KHR_lights_\w+|KHR_animation_pointer"
    r"|KHR_xmp\w*|KHR_node_\w+|EXT_texture_webp|EXT_mesh_gpu_instancing|EXT_lights_\w+|EXT_materials_\w+|MSFT_lod"
)
_LARGEST = sys.float_info.max
_ARRAYS = (
    *("accessors", "animations", "bufferViews", "buffers", "cameras", "images", "materials", "meshes", "nodes"),
    *("samplers", "scenes", "skins", "textures"),
)
_NODE_NUMBERS = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3}


def check_glb(data: bytes, budgets: Budgets) -> None:
    """Refuse a GLB whose declarations contradict each other, its bytes or the budgets.

    Raises:
        MeshmarkError: ``truncated_file``, ``malformed_file``, ``budget_exceeded``, ``external_reference``,
            ``unsupported_format``, ``unsupported_feature`` or ``no_faces``.
    """
    version, length = int.from_bytes(data[4:8], "little"), int.from_bytes(data[8:12], "little")
    if len(data) >= 12 and version == 1:
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FORMAT, "The file is a GLB of version 1, not 2.", "Export it as a glTF 2.0 GLB."
        )
    _check_json_text(data[20 : 20 + int.from_bytes(data[12:16], "little")], budgets)
    document = Document.from_glb(data)
    if length < len(data):
        raise malformed(f"The GLB header declares {length:,} bytes, but the file has {len(data):,}.")
    json = document.json
    for kind in _ARRAYS:
        values = json.get(kind, [])
        if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
            raise malformed(f"{kind} of the GLB is not an array of objects.")
    _check_version(json)
    _check_extensions(json)
    buffers = _buffers(document)
    _check_views(json)
    _check_accessors(json, budgets)
    _check_images(json, buffers, budgets)
    _check_skins(json)
    drawn = [_mesh_counts(json, number) for number in range(len(_entries(json, "meshes")))]
    faces = vertices = 0
    for mesh, draws in _draws(document):
        faces += drawn[mesh][0] * draws
        vertices += drawn[mesh][1] * draws
    if faces == 0:
        raise no_faces(f"The scene of the GLB draws no triangle ({len(drawn):,} meshes in the file).")
    within(faces, budgets.faces, "triangles")
    within(vertices, budgets.vertices, "vertices")


def _entries(json: Json, kind: str) -> list[Json]:
    """The objects of a top-level array, empty where it is missing; :func:`check_glb` has looked at each."""
    values: list[Json] = json.get(kind, [])
    return values


def _integer(owner: Json, key: str, where: str, default: int | None = None, least: int = 0) -> int:
    value = owner.get(key, default)
    if type(value) is not int or value < least:
        raise malformed(f"{where}.{key} is {_quote(value)}, not an integer of at least {least}.")
    return value


def _reference(value: Any, json: Json, kind: str, where: str) -> int:
    count = len(_entries(json, kind))
    if type(value) is not int or not 0 <= value < count:
        raise malformed(f"{where} refers to {kind}[{_quote(value)}], but there are {count:,} {kind}.")
    return value


def _mapping(owner: Json, key: str, where: str) -> Json:
    value = owner.get(key, {})
    if not isinstance(value, dict):
        raise malformed(f"{where}.{key} is {_quote(value)}, not an object.")
    return value


def _references(owner: Json, key: str, json: Json, kind: str, where: str) -> list[int]:
    values = owner.get(key, [])
    if not isinstance(values, list):
        raise malformed(f"{where}.{key} is {_quote(values)}, not an array.")
    return [_reference(value, json, kind, f"{where}.{key}") for value in values]


def _numbers(owner: Json, key: str, where: str, count: int | None = None) -> None:
    """Check that a property, where present, is an array of ``count`` (any number if ``None``) finite numbers."""
    values = owner.get(key)
    if key not in owner:
        return
    if not isinstance(values, list) or count not in (None, len(values)) or not all(map(_is_finite, values)):
        raise malformed(f"{where}.{key} is {_quote(values)}, not an array of finite numbers of the right length.")


def _is_finite(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) <= _LARGEST


def _quote(value: Any) -> str:
    text = "missing" if value is None else str(value)
    return text if len(text) <= 40 else text[:40] + "..."


def _check_json_text(text: bytes, budgets: Budgets) -> None:
    """Bound what the JSON costs before it is parsed."""
    within(len(text), budgets.json_bytes, "bytes of JSON")
    brackets = re.sub(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"', b"", text, flags=re.DOTALL)
    brackets = brackets.translate(None, bytes(set(range(256)) - set(b"[]{}")))
    within(brackets.count(b"[") + brackets.count(b"{"), budgets.json_values, "JSON arrays and objects")
    steps = np.where(np.isin(np.frombuffer(brackets, np.uint8), tuple(b"[{")), 1, -1)
    depth = int(np.cumsum(steps).max(initial=0))
    if depth > MAX_JSON_DEPTH:
        raise malformed(f"The JSON of the GLB is nested {depth:,} deep; {MAX_JSON_DEPTH} is the most accepted.")


def _check_version(json: Json) -> None:
    asset = _mapping(json, "asset", "glTF")
    wanted = asset.get("minVersion", asset.get("version"))
    if not isinstance(wanted, str):
        raise malformed("asset.version of the GLB is missing.")
    if wanted != "2.0" and not (wanted.startswith("2.") and "minVersion" not in asset):
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FORMAT,
            f"The file asks for glTF {_quote(wanted)}; 2.0 is read.",
            "Export it as a glTF 2.0 GLB.",
        )


def _check_extensions(json: Json) -> None:
    required = json.get("extensionsRequired", [])
    if not isinstance(required, list) or not all(isinstance(name, str) for name in required):
        raise malformed("extensionsRequired of the GLB is not an array of names.")
    unknown = [name for name in required if not UNDERSTOOD.fullmatch(name)]
    if unknown:
        names = ", ".join(_quote(name) for name in unknown[:10])
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FEATURE,
            f"The GLB requires {names}, which this release does not read.",
            "Export the asset without these extensions and send it again.",
        )


def _buffers(document: Document) -> list[bytes]:
    """The bytes of each buffer, data URIs decoded once."""
    buffers = []
    for number, buffer in enumerate(_entries(document.json, "buffers")):
        where = f"buffers[{number}]"
        if "EXT_meshopt_compression" in _mapping(buffer, "extensions", where):
            raise unsupported_extension("EXT_meshopt_compression", where)
        declared = _integer(buffer, "byteLength", where, least=1)
        buffers.append(document.buffer(number))
        if declared > len(buffers[-1]):
            raise truncated(f"{where} declares {declared:,} bytes, but the file holds {len(buffers[-1]):,} of them.")
    return buffers


def _check_views(json: Json) -> None:
    for number, view in enumerate(_entries(json, "bufferViews")):
        where = f"bufferViews[{number}]"
        extensions = _mapping(view, "extensions", where)
        for name in COMPRESSED_VIEWS:
            if name in extensions:
                raise unsupported_extension(name, where)
        buffer = _reference(view.get("buffer"), json, "buffers", where)
        end = _integer(view, "byteOffset", where, 0) + _integer(view, "byteLength", where, least=1)
        length = _entries(json, "buffers")[buffer]["byteLength"]
        if end > length:
            raise malformed(f"{where} ends at byte {end:,} of buffers[{buffer}], which has {length:,}.")
        if "byteStride" in view and not 4 <= _integer(view, "byteStride", where) <= 252:
            raise malformed(f"{where}.byteStride is {view['byteStride']}, not between 4 and 252.")


def _check_accessors(json: Json, budgets: Budgets) -> None:
    total = 0
    for number, accessor in enumerate(_entries(json, "accessors")):
        where = f"accessors[{number}]"
        component, element = accessor.get("componentType"), accessor.get("type")
        if type(component) is not int or component not in COMPONENT_TYPES:
            raise malformed(f"{where}.componentType is {_quote(component)}, which glTF does not know.")
        if not isinstance(element, str) or element not in ELEMENT_TYPES:
            raise malformed(f"{where}.type is {_quote(element)}, which glTF does not know.")
        if not isinstance(accessor.get("normalized", False), bool):
            raise malformed(f"{where}.normalized is not true or false.")
        count = _integer(accessor, "count", where, least=1)
        # a triangle list has three indices a face: this is the only count that may exceed the vertices
        within(count, max(budgets.vertices, 3 * budgets.faces), f"elements in {where}")
        if "bufferView" in accessor:
            _check_fit(json, accessor, count, component, element, where)
        if "sparse" in accessor:
            total += _check_sparse(json, accessor, count, component, element, where)
        total += count * _element_bytes(component, element)
    # bytes that no buffer view backs cost memory all the same, so does one buffer view behind many accessors
    within(total, budgets.bytes, "bytes of accessor values")


def _element_bytes(component: int, element: str) -> int:
    """Bytes from the start of an element to its end; matrix columns start at multiples of 4."""
    columns, rows = ELEMENT_TYPES[element]
    column = rows * COMPONENT_TYPES[component].itemsize
    return column if columns == 1 else (columns - 1) * (-(-column // 4) * 4) + column


def _check_fit(json: Json, part: Json, count: int, component: int, element: str, where: str) -> None:
    view = _entries(json, "bufferViews")[_reference(part.get("bufferView"), json, "bufferViews", where)]
    size = _element_bytes(component, element)
    stride = view.get("byteStride", size)
    needed = _integer(part, "byteOffset", where, 0) + (count - 1) * stride + size
    if needed > view["byteLength"]:
        raise malformed(
            f"{where} declares {count:,} elements, which take {needed:,} bytes of "
            f"bufferViews[{part['bufferView']}], but that has {view['byteLength']:,}."
        )


def _check_sparse(json: Json, accessor: Json, count: int, component: int, element: str, where: str) -> int:
    """Bytes of the substituted values and their indices."""
    sparse = _mapping(accessor, "sparse", where)
    where = f"{where}.sparse"
    replaced = _integer(sparse, "count", where, least=1)
    if replaced > count:
        raise malformed(f"{where} replaces {replaced:,} of {count:,} elements.")
    indices, values = _mapping(sparse, "indices", where), _mapping(sparse, "values", where)
    index_type = indices.get("componentType")
    if type(index_type) is not int or index_type not in (5121, 5123, 5125):
        raise malformed(f"{where}.indices.componentType is {_quote(index_type)}, not an unsigned integer type.")
    _check_fit(json, indices, replaced, index_type, "SCALAR", f"{where}.indices")
    _check_fit(json, values, replaced, component, element, f"{where}.values")
    return replaced * (_element_bytes(component, element) + COMPONENT_TYPES[index_type].itemsize)


def _check_images(json: Json, buffers: list[bytes], budgets: Budgets) -> None:
    pixels = 0
    for number, image in enumerate(_entries(json, "images")):
        where = f"images[{number}]"
        if is_beside(image):
            continue
        size = image_size(_image_bytes(json, buffers, image, where))
        if size is None:
            raise MeshmarkError(
                ErrorCode.UNSUPPORTED_FEATURE,
                f"{where} of the GLB is not a PNG, JPEG, WebP or KTX2 image.",
                "Export the asset with PNG or JPEG textures.",
            )
        pixels += size[0] * size[1]
        within(pixels, budgets.image_pixels, f"texture pixels up to {where}, which has {size[0]:,} x {size[1]:,},")


def is_beside(image: Json) -> bool:
    """Whether an image of a GLB is a file in or below the GLB's own folder. It is never opened, only carried."""
    uri = image.get("uri")
    if "bufferView" in image or not isinstance(uri, str) or uri.startswith("data:"):
        return False
    try:
        parts = urlsplit(uri)
    except ValueError:
        return False
    path = unquote(parts.path).replace("\\", "/")
    return not (parts.scheme or parts.netloc or path.startswith("/") or ".." in path.split("/"))


def _image_bytes(json: Json, buffers: list[bytes], image: Json, where: str) -> memoryview:
    if "bufferView" in image:
        view = _entries(json, "bufferViews")[_reference(image["bufferView"], json, "bufferViews", where)]
        start = view.get("byteOffset", 0)
        return memoryview(buffers[view["buffer"]])[start : start + view["byteLength"]]
    uri = image.get("uri")
    if not isinstance(uri, str):
        raise malformed(f"{where} has neither a buffer view nor a URI.")
    if not uri.startswith("data:"):
        raise MeshmarkError(
            ErrorCode.EXTERNAL_REFERENCE,
            f"{where} lies in another file ({_quote(uri)}); nothing outside the uploaded file is opened.",
            "Export the asset as one self-contained GLB with its textures embedded.",
        )
    try:
        return memoryview(base64.b64decode(uri.partition(",")[2]))
    except (ValueError, binascii.Error):
        raise malformed(f"The data URI of {where} cannot be decoded.") from None


def _check_skins(json: Json) -> None:
    for number, skin in enumerate(_entries(json, "skins")):
        where = f"skins[{number}]"
        _references(skin, "joints", json, "nodes", where)
        if "inverseBindMatrices" in skin:
            _reference(skin["inverseBindMatrices"], json, "accessors", where)


def _mesh_counts(json: Json, number: int) -> tuple[int, int]:
    """Triangles and vertices that drawing a mesh once takes; primitives may share vertices."""
    mesh, where = _entries(json, "meshes")[number], f"meshes[{number}]"
    _numbers(mesh, "weights", where)
    primitives = mesh.get("primitives")
    if not isinstance(primitives, list) or not all(isinstance(primitive, dict) for primitive in primitives):
        raise malformed(f"{where}.primitives is not an array of objects.")
    triangles, vertices = 0, {}
    for index, primitive in enumerate(primitives):
        corners = _corner_count(json, primitive, f"{where}.primitives[{index}]")
        mode, attributes = primitive.get("mode", TRIANGLES), primitive["attributes"]
        if mode >= TRIANGLES and "POSITION" in attributes:
            triangles += corners // 3 if mode == TRIANGLES else max(corners - 2, 0)
            vertices[str(attributes)] = _entries(json, "accessors")[attributes["POSITION"]]["count"]
    return triangles, sum(vertices.values())


def _corner_count(json: Json, primitive: Json, where: str) -> int:
    """How many vertices a primitive draws, one after another; its references and types are checked."""
    accessors = _entries(json, "accessors")
    if _integer(primitive, "mode", where, TRIANGLES) > TRIANGLE_FAN:
        raise malformed(f"{where}.mode is {primitive['mode']}, which glTF does not know.")
    if "material" in primitive:
        _reference(primitive["material"], json, "materials", where)
    _mapping(primitive, "extensions", where)
    targets = primitive.get("targets", [])
    if not isinstance(targets, list) or not all(isinstance(target, dict) for target in targets):
        raise malformed(f"{where}.targets is not an array of objects.")
    if not isinstance(primitive.get("attributes"), dict):
        raise malformed(f"{where} has no attributes.")
    counts = set()
    for attributes in (primitive["attributes"], *targets):
        for name, number in attributes.items():
            accessor = accessors[_reference(number, json, "accessors", f"{where}, attribute {_quote(name)}")]
            counts.add(accessor["count"])
            if name == "POSITION" and accessor["type"] != "VEC3":
                raise malformed(f"The positions of {where} are not three-dimensional.")
    if len(counts) > 1:
        raise malformed(f"The attributes of {where} differ in length: from {min(counts):,} to {max(counts):,}.")
    if "indices" not in primitive:
        return max(counts, default=0)
    indices = accessors[_reference(primitive["indices"], json, "accessors", f"{where}.indices")]
    if indices["type"] != "SCALAR" or COMPONENT_TYPES[indices["componentType"]].kind != "u":
        raise malformed(f"The indices of {where} are not unsigned integers.")
    return int(indices["count"])


def _draws(document: Document) -> list[tuple[int, int]]:
    """(mesh, how often) for each node that the scene draws.

    Raises:
        MeshmarkError: ``malformed_file`` where the nodes are not a forest.
    """
    json = document.json
    nodes = _entries(json, "nodes")
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
    for number, scene in enumerate(_entries(json, "scenes")):
        _references(scene, "nodes", json, "nodes", f"scenes[{number}]")
    drawn = [nodes[number] for number in scene_nodes(document)]
    return [(node["mesh"], _instances(json, node)) for node in drawn if "mesh" in node]


def _checked_node(json: Json, number: int) -> list[int]:
    """The children of a node whose other properties are of the right type."""
    node, where = _entries(json, "nodes")[number], f"nodes[{number}]"
    if "mesh" in node:
        _reference(node["mesh"], json, "meshes", where)
    if "skin" in node:
        _reference(node["skin"], json, "skins", where)
    for key, count in _NODE_NUMBERS.items():
        _numbers(node, key, where, count)
    _numbers(node, "weights", where)
    _mapping(node, "extensions", where)
    return _references(node, "children", json, "nodes", where)


def _instances(json: Json, node: Json) -> int:
    """How often a node draws its mesh (EXT_mesh_gpu_instancing)."""
    extension = _mapping(node.get("extensions", {}), "EXT_mesh_gpu_instancing", "node")
    attributes = _mapping(extension, "attributes", "EXT_mesh_gpu_instancing")
    numbers = [_reference(value, json, "accessors", "EXT_mesh_gpu_instancing") for value in attributes.values()]
    return max((_entries(json, "accessors")[number]["count"] for number in numbers), default=1)
