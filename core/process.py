"""All changes that the engine makes to its process, each at the last moment at which it still has an effect.

Environment variables are read by libraries when they are loaded, so each is set just before its library is imported.
The engine changes nothing else of the process, also where it is used as a library.
"""

import gc
import os

RARELY = (50_000, 20, 20)  # objects between two collections, and these between those of older ones


def before_command() -> None:
    """With the command line, which ends after one asset: garbage in cycles is looked for rarely. By default that is a
    tenth of the time of a small asset, most of it while libraries are loaded."""
    gc.set_threshold(*RARELY)


def before_children(threads: int) -> None:
    """With several files at once, and before numerical libraries are loaded: their threads share the cores with the
    other processes, unless the environment says otherwise."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, str(threads))


def before_onnxruntime() -> None:
    """With ``import core``: onnxruntime reports its use to its makers unless disabled (its docs/Privacy.md)."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"


def before_opengl() -> None:
    """With the first renderer: pictures are drawn without a screen, and Mesa is kept from warning where it cannot
    write its cache of shaders, unless the environment sets that otherwise. pyrender 0.1.45 still uses a name that NumPy
    2 dropped, and imports its viewer, which would load X11's libraries."""
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    os.environ.setdefault("MESA_SHADER_CACHE_DISABLE", "true")
    import numpy as np
    import pyglet

    np.infty = np.inf  # type: ignore[attr-defined]
    pyglet.options.headless = True


def after_torch() -> None:
    """With placement: one thread. The batches are small, a second one costs more than it saves, and sums would depend
    on the machine's cores."""
    import torch

    torch.set_num_threads(1)
