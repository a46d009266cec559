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
    """View of the camera: a sphere, in world coordinates."""

    center: tuple[float, float, float]
    radius: float


class Renderer:
    """One OpenGL context and one asset at a time; use it as a context manager.

    A process holds at most one renderer at a time: closing it ends the EGL display they would share.

    Args:
        size: width and height of the pictures in pixels.

    Attributes:
        frame: of the pictures, once an asset is loaded.

    Raises:
        MeshmarkError: ``rendering_unavailable`` where no OpenGL context can be had.
    """

    frame: Frame

    def __init__(self, size: int) -> None:
        self.size = size
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
        drawer = self._context._renderer
        drawer._program_cache = ShaderProgramCache(shader_dir=str(_SHADERS))
        # Weakly, so that a renderer which is dropped is gone at once: found later among the garbage, it would take the
        # display of its context away from another one that draws.
        drawer._read_main_framebuffer = partial(_read, proxy(drawer), size)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._context.delete()

    def driver(self) -> str:
        """The name that the driver gives what draws."""
        from OpenGL.GL import GL_RENDERER, glGetString

        return str(glGetString(GL_RENDERER).decode(errors="replace"))

    def load(self, asset: Scene, frame: Frame | None = None) -> None:
        """Take an asset as it is: normals (flat shading where there are none), base colours, vertex colours, emission.

        Args:
            asset: its scene.
            frame: the view; None: of the asset. To compare two assets, show both in the frame of one.

        Raises:
            MeshmarkError: as :func:`core.rendering.drawables.drawables`.
        """
        shown = drawables(asset, texture_limit=2 * self.size)  # finer texels could not be told apart
        points = np.concatenate([drawable.positions for drawable in shown])
        scene = self._gl.Scene(bg_color=[BACKGROUND] * 3)
        textures: dict[Texture, Any] = {}
        # One mesh: within it pyrender keeps the order of primitives, between meshes it does not.
        scene.add(self._gl.Mesh([self._primitive(drawable, textures) for drawable in shown]))
        self._camera = scene.add(self._gl.PerspectiveCamera(yfov=1.0))
        self._scene, self._points = scene, points
        self.aim(frame or _frame(points))

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

    def render(self, direction: ArrayLike, up: ArrayLike) -> NDArray[np.uint8]:
        """The asset seen from ``direction`` (3,), the sphere of the frame wholly in the picture: (size, size, 3) sRGB.

        Args:
            direction: from the object to the camera.
            up: (3,), the direction that points upwards in the picture; not parallel to ``direction``.
        """
        picture, _ = self._draw(direction, up)
        return picture

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

    def _draw(self, direction: ArrayLike, up: ArrayLike, flags: int = 0) -> tuple[NDArray[np.uint8], Any]:
        backward = _unit(np.asarray(direction, dtype=np.float64))
        right = _unit(np.cross(np.asarray(up, dtype=np.float64), backward))
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([right, np.cross(backward, right), backward])
        pose[:3, 3] = self._center + EYE_DISTANCE * backward
        self._scene.set_pose(self._camera, pose)
        picture, depth = self._context.render(self._scene, flags)
        return picture, depth

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


def _frame(points: NDArray[np.float32]) -> Frame:
    """The frame of an asset with ``points`` (N, 3)."""
    center = (points.min(axis=0) + points.max(axis=0)).astype(np.float64) / 2
    x, y, z = center.tolist()
    return Frame((x, y, z), float(np.linalg.norm(points - center, axis=1).max()))


def _unit(vector: Float) -> Float:
    return np.asarray(vector / np.linalg.norm(vector))


def _read(drawer: Any, size: int, scene: Any, flags: int) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None]:
    """The picture that pyrender's ``drawer`` drew; with alpha, which tells the shading, the depth of its pixels too.

    Replaces pyrender's own, which spends most of its time on the depth, needed or not.
    """
    from OpenGL import GL
    from pyrender.constants import RenderFlags

    whole, with_depth = (0, 0, size, size), bool(flags & RenderFlags.RGBA)
    GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, drawer._main_fb_ms)
    GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, drawer._main_fb)
    GL.glBlitFramebuffer(*whole, *whole, GL.GL_COLOR_BUFFER_BIT, GL.GL_LINEAR)
    if with_depth:
        GL.glBlitFramebuffer(*whole, *whole, GL.GL_DEPTH_BUFFER_BIT, GL.GL_NEAREST)
    GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, drawer._main_fb)
    colors = GL.glReadPixels(*whole, GL.GL_RGBA if with_depth else GL.GL_RGB, GL.GL_UNSIGNED_BYTE)
    picture = np.frombuffer(colors, dtype=np.uint8).reshape(size, size, -1)[::-1].copy()  # its first row comes last
    if not with_depth:
        return picture, None
    depth = np.frombuffer(GL.glReadPixels(*whole, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT), dtype=np.float32)
    return picture, _distance(depth.reshape(size, size)[::-1], scene.main_camera_node.camera)


def _distance(depth: NDArray[np.float32], camera: Any) -> NDArray[np.float32]:
    """(S, S) distance along the view axis for values of the depth buffer, 0 where nothing is: those of 1."""
    near, far = np.float32(camera.znear), np.float32(camera.zfar)
    return np.where(depth < 1, near * far / (far - depth * (far - near)), np.float32(0))
