"""The resources of a written 3MF: materials, colours, textures and meshes, as XML."""

import re
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from core.arrays import Int
from core.formats.drawing import Drawing, Look, Part, base_colors, bytes_of
from core.formats.text_write import lines
from core.formats.vertices import joined

_CONTENT_TYPES = {"png": "image/png", "jpg": "image/jpeg"}  # those of the specification
_FORBIDDEN = re.compile("[\x00-\x1f\x7f\ud800-\udfff\ufffe\uffff]+")  # in XML 1.0, and line ends


def attribute(text: str) -> str:
    """A text as the quoted value of an XML attribute."""
    return quoteattr(_FORBIDDEN.sub(" ", text))


class Resources:
    """The resources of one model part, each written at its first use.

    Args:
        drawing: whose looks and images they are.

    Attributes:
        pictures: files of textures, by their path in the package.
    """

    def __init__(self, drawing: Drawing) -> None:
        self._drawing = drawing
        self._blocks: list[bytes] = []
        self._last = 1  # the id of the base materials, which come first
        self._bases: dict[Look, int] = {}
        self._textures: dict[int, int] = {}
        self.pictures: dict[str, bytes] = {}

    def xml(self) -> bytes:
        """All resources so far."""
        bases = b"".join(
            f"<base name={attribute(look.name or _hex(look))} displaycolor={quoteattr(_hex(look))}/>\n".encode()
            for look in self._bases
        )
        group = b'<basematerials id="1">\n' + bases + b"</basematerials>\n" if bases else b""
        return b"<resources>\n" + group + b"".join(self._blocks) + b"</resources>\n"

    def mesh(self, name: str, part: Part) -> int:
        """Add an object of the triangles of a part, and the colours that they have.

        Returns:
            Its id; 0 where none of the triangles has three points, which a 3MF does not allow.
        """
        vertex, first = joined(part.positions, part.faces)
        corners = vertex[part.faces]
        a, b, c = corners.T
        real = (a != b) & (b != c) & (c != a)  # the specification forbids others
        if not real.any():
            return 0
        kind, group, rows = self._properties(part)
        number = self._next()
        triangles = [
            lines(pattern, np.column_stack([corners, group, rows])[real & (kind == which)][:, columns])
            for which, (pattern, columns) in enumerate(_PATTERNS)
        ]
        self._blocks += [
            f'<object id="{number}" name={attribute(name)} type="model">\n<mesh>\n<vertices>\n'.encode(),
            lines('<vertex x="%r" y="%r" z="%r"/>', part.positions[first]),
            b"</vertices>\n<triangles>\n",
            *triangles,
            b"</triangles>\n</mesh>\n</object>\n",
        ]
        return number

    def composite(self, name: str, components: list[bytes]) -> int:
        """Add an object that consists of ``components``; returns its id."""
        number = self._next()
        head = f'<object id="{number}" name={attribute(name)} type="model">\n<components>\n'.encode()
        self._blocks.append(head + b"".join(components) + b"</components>\n</object>\n")
        return number

    def _next(self) -> int:
        self._last += 1
        return self._last

    def _properties(self, part: Part) -> tuple[Int, Int, Int]:
        """Of each triangle (T,) the number of a pattern, (T,) the id of a group, and (T, 3) rows in it."""
        count, looks = len(part.faces), self._drawing.looks
        kind, group, rows = np.zeros(count, np.int64), np.zeros(count, np.int64), np.zeros((count, 3), np.int64)
        colors = bytes_of(base_colors(self._drawing, part))
        tinted = np.zeros(count, bool)
        if part.colors is not None:
            tinted = (bytes_of(part.colors)[part.faces] != 255).any(axis=(1, 2))
        colored = np.zeros(count, bool)
        for number in np.unique(part.look).tolist():
            look, mine = looks[number], part.look == number
            texture = self._texture(look.image) if look.image is not None and part.uv is not None else None
            if texture is not None:
                has_uv = np.isfinite(part.uv[part.faces]).all(axis=(1, 2)) if part.uv is not None else mine
                textured = mine & ~tinted & has_uv
                kind[textured], group[textured], rows[textured] = self._coordinates(part, textured, texture)
                colored |= mine & ~textured
            elif part.colors is not None and (not look.name or tinted[mine].any()) and not look.is_neutral:
                colored |= mine
            elif not look.is_neutral:
                kind[mine], group[mine] = 1, 1
                rows[mine] = self._bases.setdefault(look, len(self._bases))
            else:
                colored |= mine & tinted
        if colored.any():
            kind[colored], group[colored], rows[colored] = self._colors(colors[colored])
        return kind, group, rows

    def _colors(self, colors: NDArray[np.uint8]) -> tuple[int, int, Int]:
        """A colour group of these (N, 3, 4) sRGB colours."""
        words = np.ascontiguousarray(colors).view(">u4")[..., 0].astype(np.int64)
        unique, rows = np.unique(words, return_inverse=True)
        number = self._next()
        self._blocks += [
            f'<m:colorgroup id="{number}">\n'.encode(),
            lines('<m:color color="#%08X"/>', unique[:, None]),
            b"</m:colorgroup>\n",
        ]
        return 2, number, rows.reshape(-1, 3)

    def _coordinates(self, part: Part, which: NDArray[np.bool_], texture: int) -> tuple[int, int, Int]:
        """A texture group of the coordinates of some triangles (T,)."""
        assert part.uv is not None
        uv = part.uv[part.faces[which]].reshape(-1, 2)
        unique, rows = np.unique(np.column_stack([uv[:, 0], 1 - uv[:, 1]]), axis=0, return_inverse=True)
        number = self._next()
        self._blocks += [
            f'<m:texture2dgroup id="{number}" texid="{texture}">\n'.encode(),
            lines('<m:tex2coord u="%.9g" v="%.9g"/>', unique),
            b"</m:texture2dgroup>\n",
        ]
        return 2, number, rows.reshape(-1, 3)

    def _texture(self, image: int) -> int | None:
        """The id of an image's texture; None for one that a 3MF cannot hold."""
        ending, data = self._drawing.images[image]
        if ending not in _CONTENT_TYPES:
            return None
        if image not in self._textures:
            number = self._textures[image] = self._next()
            path = f"3D/Textures/texture-{image + 1}.{ending}"
            self.pictures[path] = data
            self._blocks.append(
                f'<m:texture2d id="{number}" path="/{path}" contenttype="{_CONTENT_TYPES[ending]}"/>\n'.encode()
            )
        return self._textures[image]


_CORNERS = '<triangle v1="%d" v2="%d" v3="%d"'
_PATTERNS = (
    (_CORNERS + "/>", [0, 1, 2]),
    (_CORNERS + ' pid="%d" p1="%d"/>', [0, 1, 2, 3, 4]),
    (_CORNERS + ' pid="%d" p1="%d" p2="%d" p3="%d"/>', [0, 1, 2, 3, 4, 5, 6]),
)


def _hex(look: Look) -> str:
    red, green, blue, alpha = bytes_of(np.array(look.color)).tolist()
    return f"#{red:02X}{green:02X}{blue:02X}" + (f"{alpha:02X}" if alpha < 255 else "")
