import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core.embossing.pieces import mend_t_vertices
from core.geometry.edges import boundary_edges


@given(st.lists(st.lists(st.integers(1, 99), max_size=4, unique=True), min_size=3, max_size=3))
def test_vertices_of_the_other_half_on_a_side_become_vertices_of_this_half(sides: list[list[int]]) -> None:
    corners = np.array([[0.0, 0, 0], [4, 0, 1], [1, 3, 0]])
    chains = []
    points = list(corners)
    for side, shares in enumerate(sides):
        chain = [side]
        for share in sorted(shares):
            chain.append(len(points))
            points.append(corners[side] + share / 100 * (corners[(side + 1) % 3] - corners[side]))
        chains += list(zip(chain, [*chain[1:], (side + 1) % 3], strict=True))
    opposite = np.array([(b, a) for a, b in chains])
    triangles, faces = mend_t_vertices(np.array([[0, 1, 2]]), np.array([7]), np.array(points), opposite)
    assert set(map(tuple, boundary_edges(triangles).tolist())) == set(chains)
    assert set(faces.tolist()) == {7}
    a, b, c = (np.array(points)[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    whole = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) / 2
    assert np.isclose(area.sum(), whole)
    assert np.all(area > 1e-6)
