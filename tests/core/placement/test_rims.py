import numpy as np

from core.artwork.layouts import Layouts
from core.artwork.outline import text_artwork
from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from core.placement.rims import RimOptions, rims
from tests.core.placement.shapes import box, cuboid, index_of, join, moved, plane, rotation, sphere, surface

TEXT = Layouts((text_artwork("watermark"),))


def crossed(shape: Surface, where: Boxes, text: str = "watermark") -> bool:
    found = rims(shape, np.ones(len(shape.faces), dtype=bool), Layouts((text_artwork(text),)))
    return found is not None and bool(found.crossed(where, index_of(shape))[0])


def stepped(height: float) -> Surface:
    """Two halves of a plane, the right one ``height`` higher, joined by a wall that no ray from above meets."""
    x, z = [-15.0, 0.0, 0.0, 15.0], [0.0, 0.0, height, height]
    positions = np.array([[x[k], y, z[k]] for y in (-15.0, 15.0) for k in range(4)])
    quads = [(k, k + 1, k + 5, k + 4) for k in range(3)]
    return surface(positions, np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]))


def cracked() -> Surface:
    """Two halves of a plane whose edges lie on each other, but have their vertices at different places."""
    return join(moved(plane(10, 20), shift=(-5, 0, 0)), moved(plane(10, 20, 3), shift=(5, 0, 0)))


def test_a_smooth_closed_surface_has_no_rims() -> None:
    ball = sphere(15)
    assert rims(ball, np.ones(len(ball.faces), dtype=bool), TEXT) is None


def test_letters_do_not_stand_on_a_crack_that_rays_do_not_see() -> None:
    assert crossed(cracked(), box())
    assert not crossed(cracked(), box(center=(-5, 0, 0)))


def test_a_crack_between_two_letters_is_none_of_theirs() -> None:
    assert not crossed(cracked(), box(), text="I I")
    assert crossed(cracked(), box(axes=rotation((0, 0, 1), 90)), text="I I")


def test_letters_do_not_stand_on_a_fin_where_three_faces_meet() -> None:
    fin = surface(np.array([[0, -2, 0], [0, 2, 0], [0, 0, -3.0]]), np.array([[0, 1, 2]]))
    sheet = plane(20, 4, 2)
    weld_at_zero = join(sheet, fin)
    assert crossed(weld_at_zero, box(size=(6, 1, 0.5)))
    assert not crossed(sheet, box(size=(6, 1, 0.5)))


def test_letters_do_not_stand_across_a_low_step() -> None:
    assert crossed(stepped(0.05), box())
    assert not crossed(stepped(0.05), box(center=(-5, 0, 0)))


def test_what_lies_under_another_layer_is_in_nobodys_way() -> None:
    assert not crossed(join(plane(20, 20), moved(cracked(), shift=(0, 0, -0.1))), box())


def test_text_may_lie_on_both_sides_of_an_edge_that_both_of_its_faces_look_from() -> None:
    roof = moved(cuboid(20, 20, 20), rotation((0, 1, 0), 45), (0, 0, -14.2))
    assert not crossed(roof, box(size=(4, 1, 5)))
    assert crossed(cuboid(20, 20, 20), box(center=(10, 0, 10), size=(4, 1, 1)))


def test_an_asset_that_is_nothing_but_loose_triangles_has_rims_everywhere() -> None:
    sheet = plane(20, 20, 10)
    loose = surface(sheet.positions[sheet.faces].reshape(-1, 3), np.arange(600).reshape(-1, 3))
    loose.weld[:] = np.arange(600)
    assert crossed(loose, box())


def test_no_boxes_are_asked_about() -> None:
    found = rims(plane(20, 20), np.ones(2, dtype=bool), TEXT)
    assert found is not None
    assert found.crossed(Boxes.empty(), index_of(plane(20, 20))).shape == (0,)


def test_a_crease_counts_from_the_angle_that_the_options_say() -> None:
    cube, every = cuboid(10, 10, 10), np.ones(12, dtype=bool)
    assert rims(cube, every, TEXT) is not None
    assert rims(cube, every, TEXT, RimOptions(crease=-0.5)) is None
