"""Findings about a machine: which parts of what Meshmark needs are there, and what to do about the others."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path

from core import models
from core.device import Device, device, obstacle
from core.errors import MeshmarkError

LEAST_SPACE = 2**30  # bytes; a large asset, its report and its pictures take a tenth of it
FONTS = {"fonts-noto-core": "Arab", "fonts-noto-cjk": "Hani"}  # Debian's packages, each by one of its scripts


class State(StrEnum):
    """State of a part."""

    OK = "ok"
    OPTIONAL = "optional"  # it is not there, and something works less well without it
    MISSING = "missing"  # it is required


@dataclass(frozen=True)
class Finding:
    """One part of the machine.

    Attributes:
        part: its name.
        state: of the part.
        found: a sentence that says what is there.
        remedy: what to do about it; empty where nothing is to be done.
    """

    part: str
    state: State
    found: str
    remedy: str = ""


def findings() -> Iterator[Finding]:
    """All parts that the engine uses, one by one."""
    loaded = libraries()
    yield loaded
    if loaded.state is State.OK:
        yield opengl()
        yield fonts()
        yield gpu()
    yield from weights()
    yield credentials()
    yield space("disk", Path(tempfile.gettempdir()))


def libraries() -> Finding:
    """The libraries of the engine, which are loaded."""
    try:
        import core.pipeline  # noqa: F401
    except (ImportError, OSError) as error:  # OSError: a library that a library is linked with
        return Finding("libraries", State.MISSING, f"The engine cannot be loaded: {error}.", "Install Meshmark anew.")
    return Finding("libraries", State.OK, "The engine's libraries load.")


def opengl() -> Finding:
    """OpenGL without a screen."""
    from core.rendering.renderer import Renderer

    try:
        with Renderer(16) as renderer:
            return Finding("OpenGL", State.OK, f"Pictures are drawn by {renderer.driver()}.")
    except MeshmarkError as error:
        return Finding("OpenGL", State.MISSING, error.message, error.remedy)


def fonts() -> Finding:
    """Fonts of the scripts that the bundled one does not have."""
    from core.artwork.installed import packages_for

    missing = [package for package, script in FONTS.items() if package in packages_for(script)]
    if not missing:
        return Finding("fonts", State.OK, "Latin, Chinese, Arabic, Hindi and the other scripts of Noto.")
    return Finding(
        "fonts",
        State.OPTIONAL,
        "The bundled font has Latin, Greek and Cyrillic; other scripts are not there.",
        f"sudo apt-get install {' '.join(missing)}, or name a folder of fonts in MESHMARK_FONTS.",
    )


def gpu() -> Finding:
    """The device that placement is computed on."""
    try:
        if device() is Device.CUDA:
            return Finding("GPU", State.OK, "Placement is computed on CUDA.")
    except MeshmarkError as error:
        return Finding("GPU", State.MISSING, error.message, error.remedy)
    if os.environ.get("MESHMARK_DEVICE") == Device.CPU:
        return Finding("GPU", State.OK, "MESHMARK_DEVICE asks for the CPU.")
    return Finding(
        "GPU",
        State.OPTIONAL,
        f"Placement is computed on the CPU: {obstacle()}.",
        "Where there is an NVIDIA GPU: its driver, and pip install 'meshmark[cuda]'.",
    )


def weights() -> Iterator[Finding]:
    """The models that do not ship with Meshmark."""
    for listed in models.listing():
        found = f"{listed.model.name} is {listed.state}"
        if listed.state is models.State.INSTALLED:
            yield Finding("weights", State.OK, f"{found}.")
        else:
            remedy = f"meshmark models fetch {listed.model.name}"
            yield Finding("weights", State.OPTIONAL, f"{found} in {listed.path.parent}: `ss` is not measured.", remedy)


def credentials() -> Finding:
    """The library of Content Credentials."""
    if find_spec("c2pa"):
        return Finding("credentials", State.OK, "Content Credentials are read and written.")
    return Finding(
        "credentials",
        State.OPTIONAL,
        "Content Credentials are neither read nor written.",
        "pip install 'meshmark[c2pa]'",
    )


def space(part: str, folder: Path) -> Finding:
    """Room in a folder, which may not exist yet."""
    there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    if not os.access(there, os.W_OK):
        return Finding(part, State.MISSING, f"{there} cannot be written to.", "Give this user the right to.")
    free = shutil.disk_usage(there).free
    found = f"{free / 2**30:,.1f} GiB are free in {folder}."
    return Finding(part, State.OPTIONAL, found, "Make room.") if free < LEAST_SPACE else Finding(part, State.OK, found)
