from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from core.gltf.scene import scene_of
from core.rendering.pictures import DIRECTIONS, MANY, UPS, Drawn, pictures, views
from core.rendering.renderer import Part, Renderer
from tests.core.rendering.glb import QUAD, QUAD_FACES, GlbWriter, cube, plain

SIZE = 64
RED = (1.0, 0.0, 0.0, 1.0)


class Counting(Renderer):
    """A renderer that knows how often it drew."""

    drawn = 0

    def render(self, direction: ArrayLike, up: ArrayLike, part: Part | None = None) -> NDArray[np.uint8]:
        self.drawn += 1
        return super().render(direction, up, part)


@pytest.fixture
def renderer() -> Iterator[Counting]:
    with Counting(SIZE) as renderer:
        yield renderer


def ball(rings: int) -> bytes:
    """A ball of nearly twice as many triangles as ``rings`` squared."""
    across, down = np.meshgrid(np.linspace(0, 2 * np.pi, rings + 1), np.linspace(0, np.pi, rings + 1))
    points = np.stack([np.sin(down) * np.cos(across), np.cos(down), -np.sin(down) * np.sin(across)], axis=-1)
    place = np.arange((rings + 1) ** 2).reshape(rings + 1, rings + 1)
    above, after, below, last = place[:-1, :-1], place[:-1, 1:], place[1:, :-1], place[1:, 1:]
    faces = np.concatenate([np.stack([above, below, after], axis=-1), np.stack([after, below, last], axis=-1)])
    return GlbWriter().mesh(points.reshape(-1, 3), faces.reshape(-1, 3), material=plain(RED)).bytes()


def one_sided_card() -> bytes:
    """A red square that faces +Z and cannot be seen from behind."""
    return GlbWriter().mesh(QUAD, QUAD_FACES, material=plain(RED)).bytes()


def test_there_are_24_pictures_and_the_view_that_occurs_twice_is_drawn_once(renderer: Counting) -> None:
    shown = pictures(scene_of(cube()), renderer)
    assert shown.shape == (24, SIZE, SIZE, 3)
    assert shown.dtype == np.uint8
    assert renderer.drawn == 23
    np.testing.assert_array_equal(shown[0], shown[12])


def test_each_picture_is_what_the_renderer_shows_from_its_direction(renderer: Counting) -> None:
    directions = np.array([[0.0, 0, 1], [1, 0, 0], [0, 0, 1], [0, 0, -1]])
    ups = np.array([[0.0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0]])
    shown = pictures(scene_of(cube(RED)), renderer, directions, ups)
    for picture, direction, up in zip(shown, directions, ups, strict=True):
        np.testing.assert_array_equal(picture, renderer.render(direction, up))


def test_the_first_view_is_the_front_and_the_seventh_the_back(renderer: Counting) -> None:
    shown = pictures(scene_of(one_sided_card()), renderer)
    red = (shown[..., 0] > shown[..., 1].astype(int) + 50).mean(axis=(1, 2))
    assert red[0] == red.max()
    assert red[0] > 0.3
    assert red[6] == red[18] == 0


def test_the_same_asset_gives_the_same_pictures(renderer: Counting) -> None:
    first, second = (pictures(scene_of(cube()), renderer) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_pictures_to_be_compared_are_half_as_wide_and_show_the_same(renderer: Counting) -> None:
    original = views(scene_of(cube(RED)), renderer)
    np.testing.assert_array_equal(original.compared, views(scene_of(cube(RED)), renderer, renderer.frame).compared)
    assert original.compared.shape == (24, SIZE // 2, SIZE // 2, 3)
    large = pictures(scene_of(cube(RED)), renderer)
    means = large.reshape(24, SIZE // 2, 2, SIZE // 2, 2, 3).mean(axis=(2, 4))
    assert np.abs(original.compared - means).mean() < 1
    assert np.quantile(np.abs(original.compared - means), 0.95) <= 2


def test_pictures_of_many_triangles_show_the_same_as_those_of_few() -> None:
    few, many = scene_of(ball(8)), scene_of(ball(120))
    with Renderer(256) as renderer:
        plain = views(few, renderer)
        dense = views(many, renderer)
        assert plain.large[0].shape == dense.large[0].shape == (256, 256, 3)
        assert plain.compared.shape == dense.compared.shape == (24, 128, 128, 3)
        means = np.stack([dense.large[view] for view in range(24)]).reshape(24, 128, 2, 128, 2, 3).mean(axis=(2, 4))
        difference = np.abs(dense.compared - means)
        assert difference.mean() < 0.5
        assert np.quantile(difference, 0.95) <= 2
        np.testing.assert_array_equal(dense.compared, views(many, renderer).compared)


def test_an_asset_is_drawn_as_the_one_it_is_compared_with() -> None:
    """Else letters of many triangles on an asset of few would be compared with edges that are drawn another way."""
    many = scene_of(ball(120))
    with Renderer(128) as renderer:
        own = views(many, renderer)
        assert renderer.frame.triangles >= MANY
        shared = views(many, renderer, replace(renderer.frame, triangles=12))
        assert (own.compared != shared.compared).any()
        np.testing.assert_array_equal(shared.compared[3], renderer.render(DIRECTIONS[3], UPS[3], Part(64, 0, 0, 64)))


def test_large_pictures_are_drawn_when_they_are_asked_for_and_the_front_once(renderer: Counting) -> None:
    scene = scene_of(cube(RED))
    whole, seen = pictures(scene, renderer), views(scene, renderer)
    assert renderer.drawn == 2 * 23
    renderer.load(scene_of(cube()))
    for view in (0, 5, 12):
        np.testing.assert_array_equal(seen.large[view], whole[view])
    assert renderer.drawn == 2 * 23 + 2


def test_parts_are_those_of_the_whole_picture(renderer: Counting) -> None:
    whole, seen = pictures(scene_of(cube(RED)), renderer), views(scene_of(cube(RED)), renderer)
    assert isinstance(seen.large, Drawn)
    places = np.full((24, 2), 0.5)
    places[[3, 4, 5]] = [np.nan, np.nan], [0.0, 0.3], [0.8, 0.6]
    parts = seen.large.parts(places, 20)
    assert parts.keys() == set(range(24)) - {3}
    for view, (left, top) in {0: (22, 22), 4: (0, 9), 5: (41, 28), 12: (22, 22)}.items():
        there = whole[view, top : top + 20, left : left + 20]
        assert (np.abs(parts[view].astype(int) - there) <= 2).mean() > 0.97
    assert renderer.drawn == 2 * 23 + 22
    assert seen.large.parts(places, 10 * SIZE)[0].shape == (SIZE, SIZE, 3)
