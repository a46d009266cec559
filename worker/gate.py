"""Admission processes ("the gate"), each of which checks one upload: `python -m worker.gate`.

They are forked from one that the API starts (:mod:`service.template`), since what they read is hostile, and since a
single call of a parser can hold an interpreter for seconds. Each reads one JSON object and the files it names, gives up
files, the network and other processes, and answers with one JSON object: null, or the upload's error.
"""

import faulthandler
import json
import os
import resource
import socket
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from core.artwork.fonts import DEFAULT_FONT
from core.artwork.installed import font_folders
from core.artwork.lettering import layouts_of
from core.artwork.svg import logo_artwork
from core.artwork.typeface import uploaded_face
from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit
from core.parameters import parse_parameters
from core.verify.header import declared_size, picture_format
from service.template import serve
from worker import sandbox
from worker.child import CHANNEL, die_with_parent, keep_only

NICENESS = 5  # of processes: below the priority of the API, which answers all other requests
OOM_SCORE = "1000"  # oom_score_adj: the kernel kills these processes first where memory runs out
STDERR_BYTES = 2**20  # bytes of the file that stderr is
CPU_MARGIN = 5  # seconds beyond the limit, in case the API no longer enforces it


def look(request: dict[str, Any], asset: bytes | None, font: bytes | None, logo: bytes | None) -> None:
    """Check the headers of an asset, a font, a logo, and the outlines of parameters that the request has for it.

    Where the request has ``pictures``, the asset may be one.

    Raises:
        MeshmarkError: as :func:`core.formats.admission.admit` or :func:`core.verify.header.declared_size` does;
            ``invalid_font``; ``invalid_logo``; and as
            :func:`core.artwork.lettering.layouts_of`.
    """
    if font is not None:
        uploaded_face(font)
    if request["lettering"]:
        layouts_of(parse_parameters(request["lettering"]).resolved(), font, logo)
    elif logo is not None:
        logo_artwork(logo)
    if asset is not None and request["pictures"] and picture_format(asset):
        declared_size(asset)
    elif asset is not None:
        admit(asset, Budgets(**request["budgets"]))


def limit(seconds: float, memory: int) -> None:
    """Set resource limits: processor time, memory (bytes), file size, no core dumps; lower the priority."""
    for kind, most in (
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_FSIZE, STDERR_BYTES),
        (resource.RLIMIT_CPU, int(seconds) + CPU_MARGIN),
        (resource.RLIMIT_DATA, memory),
    ):
        resource.setrlimit(kind, (most, most))
    os.nice(NICENESS)
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(OOM_SCORE)


def answer(request: dict[str, Any]) -> MeshmarkError | None:
    """Check the upload that a request names; returns its error, or None."""
    try:
        names = ("asset", "font", "logo")
        asset, font, logo = (Path(request[name]).read_bytes() if request[name] else None for name in names)
        in_force = sandbox.shut((DEFAULT_FONT.parent, *font_folders()))
        if request["sandbox"] == "required" and not all(in_force.values()):
            raise RuntimeError(f"the sandbox is not whole: {in_force}")
        look(request, asset, font, logo)
    except MeshmarkError as error:
        return error
    except MemoryError:
        return MeshmarkError(
            ErrorCode.BUDGET_EXCEEDED,
            f"The file takes more than {request['memory'] // 2**20:,} MiB of memory to look through.",
            "Simplify or split the asset and send it again.",
        )
    except Exception:
        traceback.print_exc()
        return MeshmarkError(
            ErrorCode.INTERNAL_ERROR,
            "The service met a case it does not handle when it looked through this file.",
            "Export the asset again or send it as a GLB; if it happens again, report the time to the operator.",
        )
    return None


def main(template: int, *files: int) -> NoReturn:
    """Answer one request and exit.

    Args:
        template: the process that forked this one, with which it ends.
        files: descriptors of the request, of stderr and of the channel.
    """
    os.setsid()  # a process group of its own, to be killed as a whole
    die_with_parent(template)
    keep_only(*files)
    request = json.loads(sys.stdin.readline())
    limit(request["seconds"], request["memory"])
    faulthandler.enable()
    error = answer(request)
    said = None if error is None else {"code": error.code, "message": error.message, "remedy": error.remedy}
    with os.fdopen(CHANNEL, "w", encoding="utf-8") as channel:
        channel.write(json.dumps(said) + "\n")
    sys.stderr.flush()
    os._exit(0)


if __name__ == "__main__":
    serve(socket.socket(fileno=sys.stdin.fileno()), main)
