"""An attack: whoever has only the marked file tries to get the clean asset back from what the file lets him know.

It draws no conclusions from the shape, as a removal attack would; it reads what nothing draws, tells old vertices from
new ones by their order, and goes by names. Each guess is a soup of triangles that shall be the clean asset.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from core.arrays import Float, Int
from tests.glb_file import GlbFile, Json
from tests.residue import covered_bytes, used_accessors

TELLTALE = ("mark", "letter", "text", "emboss", "caps", "wall")


def guesses(marked: bytes) -> Iterator[tuple[str, Float]]:
    """How, and the (F, 3, 3) corners in the coordinates of meshes."""
    file = GlbFile(marked)
    yield from _by_unreferenced_accessors(file)
    yield from _by_raw_bytes(file)
    for number, primitive in enumerate(file.primitives()):
        if primitive.get("mode", 4) == 4 and "POSITION" in primitive["attributes"]:
            yield from _by_order(file, number, primitive)
    yield from _by_names(file)


def recovered(soup: Float, original: bytes, marked: bytes) -> float:
    """Of the triangles of the asset that the marked file no longer draws, the share that a guess contains, less those
    that it contains and that are not the asset's: whoever guesses all triples knows nothing."""
    clean, guess = _keys(_drawn(GlbFile(original))), _keys(soup)
    gone = clean - _keys(_drawn(GlbFile(marked)))
    return max(len(gone & guess) - len(guess - clean), 0) / len(gone) if gone else 0.0


def gives(marked: bytes, original: bytes, least: float = 0.05) -> list[str]:
    """The guesses that give back more than a share of what the marks took away."""
    found = [(how, recovered(soup, original, marked)) for how, soup in guesses(marked)]
    return [f"{how}: {share:.0%} of it" for how, share in found if share >= least]


def _drawn(file: GlbFile) -> Float:
    soups = [np.zeros((0, 3, 3))]
    for primitive in file.primitives():
        if "POSITION" in primitive["attributes"] and primitive.get("mode", 4) in (4, 5, 6):
            soups.append(file.numbers(primitive["attributes"]["POSITION"])[file.triangles(primitive)])
    return np.concatenate(soups)


def _keys(soup: Float) -> set[bytes]:
    """Each triangle by its corners, whichever comes first and whichever way round."""
    if not len(soup):
        return set()
    corners = np.ascontiguousarray(soup.astype("<f4") + np.float32(0)).view("V12")[..., 0]
    return {b"".join(sorted(corner.tobytes() for corner in triangle)) for triangle in corners}


def _by_unreferenced_accessors(file: GlbFile) -> Iterator[tuple[str, Float]]:
    """Every pair of positions and indices that nothing refers to, or that something else refers to."""
    entries, used = file.entries("accessors"), used_accessors(file)
    known = {(p["attributes"].get("POSITION"), p.get("indices")) for p in file.primitives()}
    places = [n for n, entry in enumerate(entries) if entry["type"] == "VEC3" and _readable(file, entry)]
    indices = [n for n, entry in enumerate(entries) if entry["type"] == "SCALAR" and _readable(file, entry)]
    for place in places:
        points = file.numbers(place)
        for index in [None, *indices]:
            if (place, index) in known or (place in used and (index is None or index in used)):
                continue
            rows = np.arange(len(points)) if index is None else file.read(index)[:, 0].astype(np.int64)
            if len(rows) >= 3 and rows.max(initial=0) < len(points):
                yield f"accessors[{place}] by {index}", points[rows[: len(rows) // 3 * 3].reshape(-1, 3)]


def _readable(file: GlbFile, entry: Json) -> bool:
    return "bufferView" in entry and entry["count"] > 0 and bool(file.views[entry["bufferView"]])


def _by_raw_bytes(file: GlbFile) -> Iterator[tuple[str, Float]]:
    """Bytes that belong to nothing, as rows of positions and indices of them all behind these."""
    for number, (data, covered) in enumerate(zip(file.buffers, covered_bytes(file), strict=True)):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], ~covered, [False]])))
        for first, last in edges.reshape(-1, 2).tolist():
            start = -(-first // 4) * 4
            dead = data[start : start + (last - start) // 4 * 4]
            for kind in ("<u2", "<u4"):
                words = np.frombuffer(dead, kind)
                step = 12 // words.itemsize
                largest = np.maximum.accumulate(words[::-1].astype(np.int64))[::-1]
                for count in (n for n in range(3, len(words) // step) if largest[n * step] == n - 1):
                    points = np.frombuffer(dead, "<f4", 3 * count).reshape(-1, 3)
                    rows = words[count * step :][: (len(words) - count * step) // 3 * 3].astype(np.int64)
                    yield f"bytes {start} of buffers[{number}] as {count} rows", points[rows.reshape(-1, 3)]


def _by_order(file: GlbFile, number: int, primitive: Json) -> Iterator[tuple[str, Float]]:
    """Take the first rows, or the first triangles, for the old ones, and close the gaps between them.

    Wherever the rows that triangles use pass a limit for the first time, the limit may be where new rows begin.
    """
    points = file.numbers(primitive["attributes"]["POSITION"])
    triangles = file.triangles(primitive)
    highest = np.maximum.accumulate(triangles.max(axis=1))
    lowest = np.minimum.accumulate(triangles.max(axis=1)[::-1])[::-1]
    splits = np.flatnonzero(lowest[1:] > highest[:-1]) + 1  # after these triangles only newer rows have a part
    jumps = np.flatnonzero(np.diff(triangles.max(axis=1).astype(float)) > len(points) / 20) + 1
    for split in sorted({*splits[:: max(len(splits) // 20, 1)].tolist(), *jumps[:20].tolist()}):
        limit = int(highest[split - 1]) + 1
        old = triangles[(triangles < limit).all(axis=1)]
        for name, kept in (("the first triangles", triangles[:split]), ("those of the first rows", old)):
            yield f"primitive {number}, {name} up to {split}", _closed(points, kept, limit)


def _closed(points: Float, kept: Int, limit: int) -> Float:
    """The kept triangles, and fans over the loops of their open edges and over old rows that nothing uses."""
    _, weld = np.unique(points, axis=0, return_inverse=True)
    edges = np.concatenate([kept[:, [0, 1]], kept[:, [1, 2]], kept[:, [2, 0]]])
    there = {tuple(edge) for edge in weld[edges].tolist()}
    after: dict[int, int] = {}
    for a, b in edges.tolist():
        if (int(weld[b]), int(weld[a])) not in there:
            after[int(weld[b])] = b
            after.setdefault(-1 - int(weld[b]), a)
    following = {at: int(weld[after[-1 - at]]) for at in after if at >= 0}
    soup, extent = [points[kept]], np.ptp(points, axis=0).max()
    loose = points[np.setdiff1d(np.arange(limit), kept)]
    while following:
        start, at = following.popitem()
        loop = [start]
        while at != start and at in following:
            loop.append(at)
            at = following.pop(at)
        corners = np.array([points[after[each]] for each in loop if each in after])
        if len(corners) < 3 or np.ptp(corners, axis=0).max() > extent / 3:  # the rim of an open asset is no gap
            continue
        middle, ring = corners[0], list(pairwise(corners[1:]))
        center, reach = corners.mean(axis=0), np.ptp(corners, axis=0).max() / 2
        if len(loose) and (away := np.linalg.norm(loose - center, axis=1)).min() < reach:
            middle, ring = loose[away.argmin()], list(zip(corners, np.roll(corners, -1, axis=0), strict=True))
        soup += [np.stack([middle, a, b])[None] for a, b in ring]
    return np.concatenate(soup)


def _by_names(file: GlbFile) -> Iterator[tuple[str, Float]]:
    """Leave out whatever says that it is ours."""
    materials = [str(entry.get("name", "")).lower() for entry in file.entries("materials")]
    soups = [np.zeros((0, 3, 3))]
    left = 0
    for mesh in file.entries("meshes"):
        for primitive in mesh["primitives"]:
            name = materials[primitive["material"]] if "material" in primitive else ""
            names = f"{mesh.get('name', '')} {name} {primitive.get('extras', '')}".lower()
            if any(word in names for word in TELLTALE):
                left += 1
            elif primitive.get("mode", 4) == 4 and "POSITION" in primitive["attributes"]:
                points = file.numbers(primitive["attributes"]["POSITION"])
                soups.append(_closed(points, file.triangles(primitive), len(points)))
    if left:
        yield f"{left} primitives by their names", np.concatenate(soups)


def telltale_names(marked: bytes, original: bytes) -> list[str]:
    """What of the words of the marked file, keys and values, was not in the asset and says what is ours."""
    words = _words(GlbFile(marked).json) - _words(GlbFile(original).json)
    return sorted(
        word for word in words if any(part in word.lower() for part in TELLTALE) and "texture" not in word.lower()
    )


def _words(node: object) -> set[str]:
    if isinstance(node, dict):
        return set(node).union(*map(_words, node.values())) if node else set()
    if isinstance(node, list):
        return set().union(*map(_words, node))
    return {node} if isinstance(node, str) else set()
