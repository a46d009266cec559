"""All that the engine changes of the process it runs in, each at the last moment at which it still has an effect.

Environment variables are read by libraries when they are loaded, so each is set just before its library is imported.
Nothing else of the engine touches the process: where it lends itself to others, as a library, this is what they get.
"""

import os


def before_onnxruntime() -> None:
    """With ``import core``: onnxruntime reports what it is used for to its makers unless told not to (its
    docs/Privacy.md)."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"


def before_opengl() -> None:
    """With the first renderer: pictures are drawn without a screen, and Mesa is kept from warning where it cannot
    write its cache of shaders, unless somebody set that otherwise. pyrender 0.1.45 still uses a name that NumPy 2
    dropped, and imports its viewer, which would look for X11's libraries."""
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    os.environ.setdefault("MESA_SHADER_CACHE_DISABLE", "true")
    import numpy as np
    import pyglet

    np.infty = np.inf  # type: ignore[attr-defined]
    pyglet.options.headless = True


def after_torch() -> None:
    """With placement: one thread. The batches are small, a second one costs more than it brings, and sums would depend
    on the machine's cores."""
    import torch

    torch.set_num_threads(1)
