"""OFF, as text: the vertices of a marked scene, with colours."""

import numpy as np

from core.formats.corners import corners_of
from core.formats.format import Format, Written
from core.formats.marked import Marked, coordinates, drawn_again
from core.formats.off import check_off, read_off
from core.formats.text_write import lines


def write_off(marked: Marked) -> Written:
    """The surface of an OFF with the numbers of its input; it has colours where that has some, or letters do."""
    frame = coordinates(marked.format, Format.OFF)
    header = check_off(marked.source, marked.budgets)
    before = read_off(marked.source, header, marked.budgets).bodies[0]
    drawing = drawn_again(marked, before.positions, vertex_colors=True)
    corners = corners_of(drawing, keep_colors=marked.had_colors)
    first, vertex = corners.vertices(mapped=False)
    table = np.concatenate([part.positions for part in drawing.parts])[corners.points.reshape(-1)[first]]
    if corners.colors is not None:
        table = np.hstack([table, corners.colors[first] / 255])
    data = b"".join(
        [
            b"OFF\n" if corners.colors is None else b"COFF\n",
            f"{len(table)} {len(vertex)} 0\n".encode(),
            lines("%r %r %r" + " %.6g" * (table.shape[1] - 3), table),
            lines("3 %d %d %d", vertex),
        ]
    )
    lost = {"vertex normals": corners.normals is not None, "texture coordinates": corners.uv is not None}
    left_out = [*(what for what, there in lost.items() if there), *drawing.left_out]
    return Written({"model.off": data}, frame.unit, frame.up, left_out)
