"""Pictures of a GLB: pyrender behind one small interface, headless through EGL."""

from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Self
from weakref import proxy

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core import process
from core.arrays import Float
from core.errors import ErrorCode, MeshmarkError
from core.geometry.directions import EYE_DISTANCE, field_of_view
from core.gltf.scene import Scene
from core.gltf.textures import Texture
from core.rendering.drawables import Drawable, drawables

Float32 = NDArray[np.float32]

BACKGROUND = 0.92  # sRGB grey
AROUND = 2  # pixels drawn on each side of the asset
CELLS = 64  # along the longest side of an asset, by which its outline is known well enough

_SHADERS = Path(__file__).parent / "shaders"
_ARRAYS = ("ctypesarrays", "ctypesparameters", "ctypespointers", "lists", "numpymodule", "strings")  # of PyOpenGL


def _pyrender() -> ModuleType:
    """pyrender, imported only when something is drawn: ``import core`` must work where there is no OpenGL."""
    process.before_opengl()
    import pyrender

    return pyrender  # type: ignore[no-any-return]


def preload() -> None:
    """Import the libraries of a renderer, without opening a display."""
    with suppress(Exception):  # where there is no OpenGL, the renderer raises
        _pyrender()
        for name in ("pyrender.platforms.egl", *(f"OpenGL.arrays.{handler}" for handler in _ARRAYS)):
            import_module(name)


@dataclass(frozen=True)
class Frame:
    """View of the camera: a sphere, in world coordinates.

    Attributes:
        center, radius: of the sphere.
        triangles: drawn of the asset whose own frame it is, by which pictures of assets that share it are drawn alike;
            0 for any other frame.
    """

    center: tuple[float, float, float]
    radius: float
    triangles: int = 0


@dataclass(frozen=True)
class Part:
    """A square of a picture, or all of it; it alone is drawn.

    Attributes:
        of: width and height of the picture, pixels.
        left, top: place of the square in it, pixels.
        side: width and height of the square, pixels, as large as the renderer's pictures at most.
    """

    of: int
    left: int
    top: int
    side: int


@dataclass(frozen=True)
class _Bounds:
    """Rectangle of a part, as OpenGL counts its pixels: from the lower left."""

    left: int
    bottom: int
    width: int
    height: int

    @property
    def corners(self) -> tuple[int, int, int, int]:
        """Left, bottom, right, and top."""
        return self.left, self.bottom, self.left + self.width, self.bottom + self.height


class Renderer:
    """One OpenGL context and one asset at a time; use it as a context manager.

    A process holds at most one renderer at a time: closing it ends the EGL display they would share.

    Args:
        size: width and height of the pictures in pixels, unless a part is asked for.

    Attributes:
        frame: of the pictures, once an asset is loaded.

    Raises:
        MeshmarkError: ``rendering_unavailable`` where no OpenGL context can be had.
    """

    frame: Frame

    def __init__(self, size: int) -> None:
        self.size = size
        self._asset: Scene | None = None
        try:
            self._gl = _pyrender()
            self._context = self._gl.OffscreenRenderer(size, size)
        except Exception as error:  # each layer down to the driver raises errors of its own
            raise MeshmarkError(
                ErrorCode.RENDERING_UNAVAILABLE,
                f"This machine offers no OpenGL context to draw pictures with ({type(error).__name__}).",
                "Install libegl1 and libgl1-mesa-dri.",
            ) from error
        from pyrender.shader_program import ShaderProgramCache

        # pyrender's own shader leaves back faces and surfaces without normals dark and ignores alpha cutoffs.
        self._context._renderer._program_cache = ShaderProgramCache(shader_dir=str(_SHADERS))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the context; nothing can be drawn after that."""
        self._context.delete()

    def driver(self) -> str:
        """The name that the driver gives what draws."""
        from OpenGL.GL import GL_RENDERER, glGetString

        return str(glGetString(GL_RENDERER).decode(errors="replace"))

    def load(self, asset: Scene, frame: Frame | None = None) -> None:
        """Take an asset as it is: normals (flat shading where there are none), base colours, vertex colours, emission.

        An asset that is loaded already is only shown in the other frame.

        Args:
            asset: its scene.
            frame: the view; None: of the asset. To compare two assets, show both in the frame of one.

        Raises:
            MeshmarkError: as :func:`core.rendering.drawables.drawables`.
        """
        fresh = asset is not self._asset
        if fresh:
            shown = drawables(asset, texture_limit=2 * self.size)  # finer texels could not be told apart
            scene = self._gl.Scene(bg_color=[BACKGROUND] * 3)
            textures: dict[Texture, Any] = {}
            # One mesh: within it pyrender keeps the order of primitives, between meshes it does not.
            scene.add(self._gl.Mesh([self._primitive(drawable, textures) for drawable in shown]))
            self._camera = scene.add(self._gl.PerspectiveCamera(yfov=1.0))
            points = np.concatenate([drawable.positions for drawable in shown])
            self._asset, self._scene, self._points = asset, scene, points
            self._whole = _frame(points, sum(len(drawable.faces) for drawable in shown))
            self._cells, self._cell = _cells(points)
        wanted = frame or self._whole
        if fresh or wanted != self.frame:
            self.aim(wanted)

    def aim(self, frame: Frame) -> None:
        """Turn the camera to another ``frame`` of the asset that is loaded: a small one is seen from near by."""
        self.frame, self._center = frame, np.array(frame.center)
        # Geometry outside the frame is not clipped by the planes of the camera.
        depth = max(frame.radius, float(np.linalg.norm(self._points - self._center, axis=1).max()))
        self._camera.camera = self._gl.PerspectiveCamera(
            yfov=field_of_view(frame.radius),
            aspectRatio=1.0,
            znear=max(EYE_DISTANCE - depth, EYE_DISTANCE / 100),
            zfar=EYE_DISTANCE + depth,
        )

    def render(self, direction: ArrayLike, up: ArrayLike, part: Part | None = None) -> NDArray[np.uint8]:
        """The asset seen from ``direction`` (3,), the sphere of the frame wholly in the picture: (size, size, 3) sRGB.

        Args:
            direction: from the object to the camera.
            up: (3,), the direction that points upwards in the picture; not parallel to ``direction``.
            part: of the picture, (side, side, 3); None: all of it.
        """
        picture, _ = self._draw(direction, up, part=part)
        return picture

    def render_half(self, direction: ArrayLike, up: ArrayLike) -> NDArray[np.uint8]:
        """As :meth:`render`, half as wide: (size // 2, size // 2, 3). Each pixel is the mean of four that are drawn
        with one sample, not one with four samples, each of which llvmpipe looks for in every triangle."""
        import cv2  # here: the renderer is loaded by all who may draw

        picture, _ = self._draw(direction, up, single=True)
        half = (self.size // 2, self.size // 2)
        return np.asarray(cv2.resize(picture, half, interpolation=cv2.INTER_AREA), dtype=np.uint8)

    def render_with_depth(
        self, direction: ArrayLike, up: ArrayLike
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.float32]]:
        """As :meth:`render`, with depth and shading of each pixel.

        Returns:
            The picture (size, size, 3); the distance along the view axis in size-30 units, 0 in the background; and the
            share of each pixel's colour that is lit, 0 on unlit surfaces to 1 on those without emission.
        """
        picture, depth = self._draw(direction, up, self._gl.RenderFlags.RGBA)
        # Blending over a lit surface leaves at least three quarters: a² + (1 - a).
        shaded = np.minimum(picture[..., 3] / np.float32(0.75 * 255), 1)
        return np.ascontiguousarray(picture[..., :3]), depth, shaded

    def _draw(
        self, direction: ArrayLike, up: ArrayLike, flags: int = 0, part: Part | None = None, single: bool = False
    ) -> tuple[NDArray[np.uint8], Any]:
        backward = _unit(np.asarray(direction, dtype=np.float64))
        right = _unit(np.cross(np.asarray(up, dtype=np.float64), backward))
        axes = np.stack([right, np.cross(backward, right), backward])
        pose = np.eye(4)
        pose[:3, :3] = axes.T
        pose[:3, 3] = self._center + EYE_DISTANCE * backward
        self._scene.set_pose(self._camera, pose)
        part = part or Part(self.size, 0, 0, self.size)
        bounds, drawer = self._bounds(axes, part), self._context._renderer
        self._context.viewport_width = self._context.viewport_height = part.side
        # Weakly, so that a renderer which is dropped is gone at once: found later among the garbage, it would take the
        # display of its context away from another one that draws.
        drawer._configure_forward_pass_viewport = partial(_confine, proxy(drawer), part, bounds, single)
        drawer._read_main_framebuffer = partial(_read, proxy(drawer), part.side, bounds, single)
        picture, depth = self._context.render(self._scene, flags)
        return picture, depth

    def _bounds(self, axes: Float, part: Part) -> _Bounds:
        """Bounds of the asset in a ``part``; ``axes`` (3, 3) are the camera's, to the right, up and back."""
        seen = axes @ (self._cells - self._center).T
        # Distances of the near and of the far end of each cell.
        distance = EYE_DISTANCE - seen[2] + self._cell * np.array([[-1], [1]])
        if not distance.min() > self._camera.camera.znear:  # the camera may stand among what it looks at
            return _Bounds(0, 0, part.side, part.side)
        scale = part.of / 2 / np.tan(self._camera.camera.yfov / 2) / distance[:, None]
        middle = part.of / 2 - np.array([part.left, part.of - part.top - part.side])
        low = ((seen[:2] - self._cell) * scale).min(axis=(0, 2)) + middle
        high = ((seen[:2] + self._cell) * scale).max(axis=(0, 2)) + middle
        low = np.clip(np.floor(low) - AROUND, 0, part.side - 1).astype(int)
        high = np.clip(np.ceil(high) + AROUND, low + 1, part.side).astype(int)
        return _Bounds(int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1]))

    def _primitive(self, drawable: Drawable, textures: dict[Texture, Any]) -> Any:
        material = drawable.material
        texture, uv = self._sampled(drawable.texture, drawable.uv, textures)
        glow, glow_texture, glow_uv = np.zeros(3), None, None
        if material.emission is not None and (material.emission.texture is None or drawable.emission_uv is not None):
            glow = material.emission.color
            glow_texture, glow_uv = self._sampled(drawable.emission_texture, drawable.emission_uv, textures)
        return self._gl.Primitive(
            positions=drawable.positions,
            normals=drawable.normals,
            texcoord_0=uv,
            texcoord_1=glow_uv,
            color_0=drawable.colors,
            indices=drawable.faces,
            material=self._gl.MetallicRoughnessMaterial(
                baseColorFactor=material.color,
                baseColorTexture=texture,
                emissiveFactor=glow,
                emissiveTexture=glow_texture,
                # Two slots of the shader's own use, see mesh.frag.
                metallicFactor=material.alpha_cutoff,
                roughnessFactor=0.5 * material.unlit + 0.25 * (material.alpha_mode == "BLEND"),
                alphaMode=material.alpha_mode,
                doubleSided=material.double_sided,
            ),
        )

    def _sampled(
        self, texture: Texture | None, uv: Float32 | None, textures: dict[Texture, Any]
    ) -> tuple[Any, Float | None]:
        """The pyrender texture, made once for all primitives, and its coordinates (N, 2)."""
        if texture is None or uv is None:
            return None, None
        if texture not in textures:
            textures[texture] = self._texture(texture)
        return textures[texture], uv * [1, -1] + [0, 1]  # pyrender stores images upside down: v points up

    def _texture(self, texture: Texture) -> Any:
        sampler = self._gl.Sampler(wrapS=texture.wrap[0], wrapT=texture.wrap[1])
        if texture.nearest:
            sampler.magFilter = self._gl.GLTF.NEAREST
        return self._gl.Texture(source=texture.pixels, source_channels="RGBA", sampler=sampler)


def _frame(points: NDArray[np.float32], triangles: int) -> Frame:
    """The frame of an asset with ``points`` (N, 3) and so many triangles."""
    center = (points.min(axis=0) + points.max(axis=0)).astype(np.float64) / 2
    x, y, z = center.tolist()
    return Frame((x, y, z), float(np.linalg.norm(points - center, axis=1).max()), triangles)


def _cells(points: NDArray[np.float32]) -> tuple[Float, float]:
    """(C, 3) middles of the cells of a grid in which there are any of the ``points`` (N, 3), and the radius of a cell;
    many times fewer than points."""
    low = points.min(axis=0)
    side = max(float((points.max(axis=0) - low).max()), 1e-6) / CELLS
    number = np.unique(((points - low) / np.float32(side)).astype(np.int64) @ [(CELLS + 1) ** 2, CELLS + 1, 1])
    place = np.stack(np.unravel_index(number, (CELLS + 1,) * 3), axis=1) + 0.5
    return low + side * place, float(np.sqrt(3) / 2 * side)


def _unit(vector: Float) -> Float:
    return np.asarray(vector / np.linalg.norm(vector))


def _confine(drawer: Any, part: Part, bounds: _Bounds, single: bool, flags: int) -> None:
    """Let pyrender's ``drawer`` draw a part of the picture, and in that only the bounds: background takes as long as
    what stands before it. With a ``single`` sample a pixel, it draws where it would gather its four."""
    from OpenGL import GL
    from pyrender.renderer import Renderer as Drawer

    Drawer._configure_forward_pass_viewport(drawer, flags)
    if single:
        GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, drawer._main_fb)
    GL.glViewport(-part.left, part.top + part.side - part.of, part.of, part.of)
    GL.glEnable(GL.GL_SCISSOR_TEST)
    GL.glScissor(bounds.left, bounds.bottom, bounds.width, bounds.height)


def _read(
    drawer: Any, side: int, bounds: _Bounds, single: bool, scene: Any, flags: int
) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None]:
    """The picture that pyrender's ``drawer`` drew; with alpha, which tells the shading, the depth of its pixels too.

    Replaces pyrender's own, which spends most of its time on the depth, needed or not.
    """
    from OpenGL import GL
    from pyrender.constants import RenderFlags

    with_depth = bool(flags & RenderFlags.RGBA)
    left, bottom, right, top = bounds.corners
    shown, there = (left, bottom, bounds.width, bounds.height), np.s_[side - top : side - bottom, left:right]

    def pixels(kind: Any, of: Any, dtype: type) -> NDArray[Any]:
        content: NDArray[Any] = np.frombuffer(GL.glReadPixels(*shown, kind, of), dtype=dtype)
        return content.reshape(bounds.height, bounds.width, -1)[::-1]  # the first row comes last

    if not single:
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, drawer._main_fb_ms)
        GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, drawer._main_fb)
        GL.glBlitFramebuffer(*bounds.corners, *bounds.corners, GL.GL_COLOR_BUFFER_BIT, GL.GL_LINEAR)
        if with_depth:
            GL.glBlitFramebuffer(*bounds.corners, *bounds.corners, GL.GL_DEPTH_BUFFER_BIT, GL.GL_NEAREST)
    GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, drawer._main_fb)
    picture = np.full((side, side, 4 if with_depth else 3), round(255 * BACKGROUND), dtype=np.uint8)
    picture[..., 3:] = 255
    picture[there] = pixels(GL.GL_RGBA if with_depth else GL.GL_RGB, GL.GL_UNSIGNED_BYTE, np.uint8)
    if not with_depth:
        return picture, None
    distance = np.zeros((side, side), dtype=np.float32)
    depth = pixels(GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT, np.float32)[..., 0]
    distance[there] = _distance(depth, scene.main_camera_node.camera)
    return picture, distance


def _distance(depth: NDArray[np.float32], camera: Any) -> NDArray[np.float32]:
    """(H, W) distance along the view axis for values of the depth buffer, 0 where nothing is: those of 1."""
    near, far = np.float32(camera.znear), np.float32(camera.zfar)
    return np.where(depth < 1, near * far / (far - depth * (far - near)), np.float32(0))
