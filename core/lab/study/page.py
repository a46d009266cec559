"""The page of a study: one file that needs no network, and its key."""

import base64
import hashlib
import html
import json
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path

from core.lab.benchmark.results import write_text
from core.lab.study.answers import QUESTIONS, key_json
from core.lab.study.trials import LEVEL, Trial


def write_study(shown: Iterable[Trial], out: Path, count: int) -> tuple[Path, int]:
    """Write the page of a study, and beside it ``NAME.key.json`` with what it does not tell.

    Args:
        shown: its trials.
        out: the page.
        count: number of marks that were asked for.

    Returns:
        The key's path, and the number of trials.

    Raises:
        MeshmarkError: ``output_not_writable``.
    """
    kept = list(shown)
    study = hashlib.sha256(" ".join(trial.id for trial in kept).encode()).hexdigest()[:12]
    write_text(out, study_page(study, kept))
    told = {
        trial.id: {
            "asset": trial.asset,
            "textured": trial.textured,
            "delivered": trial.delivered,
            "first": trial.methods[0],
            "second": trial.methods[1],
        }
        for trial in kept
    }
    key = out.with_suffix(".key.json")
    write_text(key, key_json(study, count, told) + "\n")
    return key, len(kept)


def study_page(study: str, trials: Iterable[Trial]) -> str:
    """HTML of a study: the pictures, the questions, and a script that asks them; no name of a method or an asset."""
    script, style = ((files("core.lab.study") / name).read_text() for name in ("study.js", "study.css"))
    content = {
        "study": study,
        "level": LEVEL,
        "questions": QUESTIONS,
        "trials": [
            {
                "id": trial.id,
                "original": [_address(picture) for picture in trial.original],
                "first": [_address(picture) for picture in trial.first],
                "second": [_address(picture) for picture in trial.second],
            }
            for trial in trials
        ],
    }
    data = json.dumps(content).replace("<", "\\u003c")  # nothing in it ends its element
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{html.escape(policy)}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Study of watermarks</title>\n<style>\n{style}</style>\n</head>\n"
        '<body>\n<main id="study"><noscript>This page needs JavaScript.</noscript></main>\n'
        f'<script type="application/json" id="content">{data}</script>\n<script>{script}</script>\n</body>\n</html>\n'
    )


def _address(picture: bytes) -> str:
    return "data:image/webp;base64," + base64.b64encode(picture).decode()
