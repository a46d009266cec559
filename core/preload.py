"""Imports at once all modules that :mod:`core.pipeline` imports on demand, for processes that run it often."""

from importlib import import_module
from importlib.util import find_spec

from core.rendering import renderer

# Modules that stages, readers and metrics import on demand; a test runs the engine and finds missing ones.
LATER = (
    *(
        "core.analysis.analyse",
        "core.analysis.contrast",
        "core.analysis.heads",
        "core.analysis.regions",
        "core.analysis.skinning",
    ),
    *("core.analysis.texture", "core.artwork.svg", "core.placement.place"),
    *("core.embossing.copies", "core.embossing.drawn", "core.embossing.marks", "core.embossing.islands"),
    *("core.embossing.unmarked", "core.planned", "core.reporting", "core.metrics.measure"),
    *("core.explain.explain", "core.explain.layers", "core.explain.trace"),
    *("core.verify.verify", "core.verify.evidence", "core.conversion"),
    *("opengl_basisu", "DracoPy", "meshopt", "manifold3d", "trimesh.exchange.dae", "rapidocr"),
    *("PIL.BmpImagePlugin", "PIL.GifImagePlugin", "PIL.JpegImagePlugin", "PIL.PngImagePlugin", "PIL.PpmImagePlugin"),
    "PIL.WebPImagePlugin",
)
OF_CREDENTIALS = "core.credentials.read"  # where the extra c2pa is installed


def preload() -> None:
    """Import the modules and nothing else: the process still has one thread and no device open, and can be forked."""
    for name in LATER:
        import_module(name)
    if find_spec("c2pa"):
        import_module(OF_CREDENTIALS)
    renderer.preload()
