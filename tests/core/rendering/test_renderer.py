"""What a renderer is given and gives: pictures of one size, the whole object in the frame, the same pixels again."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from core.errors import ErrorCode, MeshmarkError
from core.geometry.directions import fibonacci_directions, view_directions
from core.gltf.scene import scene_of
from core.rendering.renderer import Frame, Part, Renderer
from tests.core.rendering.glb import QUAD, QUAD_FACES, QUAD_UV, GlbWriter, cube
from tests.core.rendering.shots import GREY, SIZE, UP, shoot, shown


def test_a_picture_is_a_square_of_rgb_bytes_on_a_neutral_background(renderer: Renderer) -> None:
    picture = shoot(renderer, cube())
    assert picture.shape == (SIZE, SIZE, 3)
    assert picture.dtype == np.uint8
    for corner in (picture[0, 0], picture[0, -1], picture[-1, 0], picture[-1, -1]):
        np.testing.assert_allclose(corner.astype(int), GREY, atol=1)


def test_a_red_cube_is_red(renderer: Renderer) -> None:
    picture = shoot(renderer, cube((1, 0, 0, 1)), (1, 1, 1))
    inside = picture[shown(picture)]
    inside = inside[(inside != GREY).all(axis=1)]
    assert len(inside) > 500
    core = picture[SIZE // 2 - 20 : SIZE // 2 + 20, SIZE // 2 - 20 : SIZE // 2 + 20].reshape(-1, 3)
    assert (core[:, 0] > 80).all()
    assert (core[:, 1:] == 0).all()


@pytest.mark.parametrize("stretch", [(1, 1, 1), (20, 1, 1), (1, 20, 0.1)])
def test_an_object_is_wholly_in_the_frame_from_everywhere(renderer: Renderer, stretch: tuple[float, ...]) -> None:
    renderer.load(scene_of(cube((0.2, 0.2, 0.2, 1), scale=list(stretch), translation=[100.0, -50.0, 3.0])))
    directions, ups = view_directions()
    more = fibonacci_directions(16)
    for direction, up in zip(np.r_[directions, more], np.r_[ups, np.tile(UP, (16, 1))], strict=True):
        visible = shown(renderer.render(direction, up))
        assert visible.any()
        assert visible[1:-1, 1:-1].sum() == visible.sum()


def test_the_same_view_gives_the_same_pixels_in_a_new_context(renderer: Renderer) -> None:
    del renderer  # contexts of one process share a display, so the other picture is taken in another process
    code = (
        "import hashlib; from core.rendering.renderer import Renderer; from core.gltf.scene import scene_of\n"
        "from tests.core.rendering.glb import cube\n"
        "with Renderer(64) as renderer:\n"
        "    renderer.load(scene_of(cube((0.3, 0.6, 0.9, 1))))\n"
        "    print(hashlib.sha256(renderer.render((1, 2, 3), (0, 1, 0)).tobytes()).hexdigest())"
    )
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in range(2)]
    assert runs[0].stdout == runs[1].stdout != ""


def test_malformed_attributes_are_refused(renderer: Renderer) -> None:
    glb = GlbWriter().mesh(QUAD, QUAD_FACES, {"NORMAL": QUAD[:2]}).bytes()
    with pytest.raises(MeshmarkError, match="NORMAL") as caught:
        renderer.load(scene_of(glb))
    assert caught.value.code == ErrorCode.MALFORMED_FILE


def test_numbers_that_are_not_finite_do_not_reach_the_picture(renderer: Renderer) -> None:
    uv = np.full_like(QUAD_UV, np.nan)
    normals = np.full_like(QUAD, np.inf)
    glb = GlbWriter().mesh(QUAD, QUAD_FACES, {"NORMAL": normals, "TEXCOORD_0": uv}).bytes()
    assert shown(shoot(renderer, glb))[SIZE // 2, SIZE // 2]


def test_without_opengl_the_error_says_what_to_install() -> None:
    code = (
        "from core.errors import MeshmarkError\nfrom core.rendering.renderer import Renderer\n"
        "try:\n    Renderer(64)\nexcept MeshmarkError as error:\n    print(error.code, error.remedy)"
    )
    environment = os.environ | {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent.json"}
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert run.stdout.strip() == "rendering_unavailable Install libegl1 and libgl1-mesa-dri."


def test_pictures_are_drawn_where_there_are_no_libraries_of_x11() -> None:
    code = (
        "import pyglet.lib\n"
        "load = pyglet.lib.load_library\n"
        "def without_x11(*names, **options):\n"
        "    if any(str(name).startswith('X') for name in names):\n"
        "        raise ImportError(f'{names} is not installed')\n"
        "    return load(*names, **options)\n"
        "pyglet.lib.load_library = without_x11\n"
        "from core.rendering.renderer import Renderer\n"
        "from core.gltf.scene import scene_of\n"
        "from tests.core.rendering.glb import cube\n"
        "with Renderer(64) as renderer:\n"
        "    renderer.load(scene_of(cube((0.3, 0.6, 0.9, 1))))\n"
        "    print(len(renderer.render((1, 2, 3), (0, 1, 0))))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "64"


def test_importing_the_renderer_needs_no_opengl() -> None:
    code = "import sys, core.rendering.preview; print({'OpenGL', 'pyrender'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_no_cache_of_shaders_is_written_nor_warned_of(tmp_path: Path) -> None:
    code = "from core.rendering.renderer import Renderer\nwith Renderer(64): pass"
    environment = os.environ | {
        "MESA_SHADER_CACHE_DIR": str(tmp_path / "missing"),
        "HOME": "/proc",
        "XDG_CACHE_HOME": "/proc",
    }
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert run.stderr == ""


def test_a_renderer_that_is_dropped_is_gone_before_another_one_draws() -> None:
    program = """
import gc, sys, weakref
from core.gltf.scene import scene_of
from core.rendering.renderer import Frame, Part, Renderer
from tests.core.rendering.glb import cube
gc.disable()
renderer = Renderer(64)
renderer.load(scene_of(cube()))
renderer.render((0, 0, 1), (0, 1, 0))
renderer.render_with_depth((0, 0, 1), (0, 1, 0))
left = weakref.ref(renderer._context._renderer)
del renderer
sys.exit(left() is not None)
"""
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize("nearer", [1, 4])
def test_only_what_shows_the_asset_is_drawn_and_none_of_it_is_cut_off(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch, nearer: int
) -> None:
    """From near by too, where the asset passes the edges of the picture."""
    renderer.load(scene_of(cube((0.2, 0.5, 0.3, 1), scale=[9, 2, 1], translation=[3, -1, 2])))
    renderer.aim(Frame(renderer.frame.center, renderer.frame.radius / nearer))
    cameras = list(zip(fibonacci_directions(12), np.tile(UP, (12, 1)), strict=True))
    confined = [(renderer.render(*camera), *renderer.render_with_depth(*camera)) for camera in cameras]
    bounds = [renderer._bounds(np.eye(3), Part(SIZE, 0, 0, SIZE))]
    monkeypatch.setattr("core.rendering.renderer.AROUND", SIZE)
    free = [(renderer.render(*camera), *renderer.render_with_depth(*camera)) for camera in cameras]
    for one, other in zip(confined, free, strict=True):
        for ours, theirs in zip(one, other, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert bounds[0].height < SIZE / 2 or nearer == 4
