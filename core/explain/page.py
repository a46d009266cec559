"""The page of an explanation: one file that needs no network, beside its pictures, its model and its figures."""

import base64
import html
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from core.errors import ErrorCode, MeshmarkError
from core.explain.explain import Explanation
from core.explain.layers import Layer, close_ups, layers, model, pictures

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
STYLE = """
:root { color-scheme: light dark; --ink: #1b1f24; --soft: #59636e; --line: #d1d9e0; --ground: #fff; --raised: #f6f8fa;
  --bar: #0b5cad }
@media (prefers-color-scheme: dark) { :root { --ink: #e6edf3; --soft: #9198a1; --line: #3d444d; --ground: #0d1117;
  --raised: #161b22; --bar: #58a6ff } }
* { box-sizing: border-box }
body { margin: 0 auto; padding: 1.5rem 1rem 3rem; max-width: 68rem; background: var(--ground); color: var(--ink);
  font: 1rem/1.5 system-ui, sans-serif; overflow-wrap: anywhere }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0 0 .25rem }
h2 { font-size: 1.15rem; margin: 2.25rem 0 .5rem; padding-top: .75rem; border-top: 1px solid var(--line) }
p { margin: .5rem 0; max-width: 44rem }
.soft { color: var(--soft) }
table { border-collapse: collapse; width: 100% }
th, td { text-align: left; vertical-align: top; padding: .35rem .75rem .35rem 0; border-bottom: 1px solid var(--line) }
th { font-weight: 600 }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap }
meter { width: 8rem; height: .7rem }
figure { margin: 1.25rem 0; break-inside: avoid }
figure img { display: block; width: 100%; border: 1px solid var(--line); border-radius: .5rem }
figcaption { padding-top: .35rem }
.swatch { display: inline-block; width: .8em; height: .8em; border-radius: .2em; margin-right: .4em }
.marks { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: 1rem }
.marks article { border: 1px solid var(--line); border-radius: .5rem; overflow: hidden; background: var(--raised) }
.marks img { display: block; width: 100% }
.marks div { padding: .6rem .75rem }
.marks td, .marks th { padding: .15rem .4rem .15rem 0; font-size: .9rem; border: 0 }
"""
LEAST = 5e-5  # share of all directions; costs below it are not told on the page
TERMS = {
    "obstructed": "hidden in views that it faces",
    "salient": "on salient surface",
    "roll": "leaning text",
    "curvature_deviation": "bent ground",
    "rough": "rough ground",
    "edge_proximity": "near an edge",
    "folded": "over a fold",
    "articulation": "over a joint",
    "detail": "on details of the texture",
    "busy": "on busy texture",
    "face": "on a face",
    "feature": "on a feature",
    "last_resort": "mostly on features: a last resort",
    "preferred": "on a preferred place",
    "mark": "one more mark",
    "distance": "change of the shape",
}
TITLES = {
    "candidates": "drawn on the surface",
    "aligned": "fitted to the surface",
    "distinct": "no copies of each other",
    "free": "outside what is kept out",
    "covered": "with one layer of surface under all of it",
    "whole": "not crossed by a rim",
    "opaque": "on opaque surface",
    "smooth": "on smooth ground",
    "open": "with nothing right in front",
    "thick": "on a wall thick enough",
    "seen": "seen from at least one direction",
}


def write_explanation(explained: Explanation, name: str, out: Path) -> list[Path]:
    """Write ``index.html``, ``explanation.json``, ``explanation.glb`` and a picture of each layer into a folder.

    Args:
        explained: the placement.
        name: of the asset's file.
        out: the folder; it is made where it is not there.

    Returns:
        What was written.

    Raises:
        MeshmarkError: ``rendering_unavailable``; ``output_not_writable``.
    """
    shown = layers(explained)
    drawn, near = pictures(explained, shown), close_ups(explained)
    files = {
        "index.html": explanation_page(explained.facts, name, shown, drawn, near).encode(),
        "explanation.json": (json.dumps(explained.facts, indent=1, ensure_ascii=False) + "\n").encode(),
        "explanation.glb": model(explained, shown),
        **{f"{layer}.png": picture for layer, picture in drawn.items()},
        **{f"mark-{number}.png": picture for number, picture in enumerate(near, 1)},
    }
    try:
        out.mkdir(parents=True, exist_ok=True)
        for file, content in files.items():
            partial = out / (file + ".partial")
            partial.write_bytes(content)
            partial.replace(out / file)
    except OSError as error:
        raise MeshmarkError(
            ErrorCode.OUTPUT_NOT_WRITABLE, f"{out} cannot be written: {error.strerror}.", "Choose another --out."
        ) from None
    return [out / file for file in files]


def explanation_page(
    facts: Mapping[str, Any],
    name: str,
    shown: Sequence[Layer],
    drawn: Mapping[str, bytes],
    near: Sequence[bytes],
) -> str:
    """HTML of an explanation; everything that comes from the file is text.

    Args:
        facts: ``meshmark.explanation/1``.
        name: of the asset's file.
        shown: the layers.
        drawn: PNG of each, by name.
        near: PNG of each mark from near by.
    """
    parts = [
        f"<h1>Why the marks stand where they stand</h1><p class='soft'><bdi>{html.escape(name)}</bdi></p>",
        _summary(facts),
        "<h2>From candidates to places</h2>" + _stages(facts["stages"]),
        "<p class='soft'>Lower text is tried only for directions that higher text does not show, and chosen places are "
        f"moved and widened once more: {len(facts['searches'])} searches in all.</p>",
        "<h2>Pictures</h2>",
        *(_figure(layer, drawn[layer.name]) for layer in shown),
        "<h2>Marks</h2>" if facts["marks"] else "",
        _marks(facts["marks"], near),
        "<h2>Chosen, and refused</h2>" + _refused(facts["refused"]) if facts["refused"] else "",
        "<h2>To turn and look at</h2><p><code>explanation.glb</code>, beside this page, has the asset in grey clay and "
        "each of these layers as a node of its own, for any viewer of glTF that can hide nodes; "
        "<code>explanation.json</code> has all figures.</p>",
    ]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{html.escape(POLICY)}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Placement explained</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(parts)
        + "\n</main>\n</body>\n</html>\n"
    )


def _summary(facts: Mapping[str, Any]) -> str:
    if error := facts["error"]:
        return f"<p><strong>{html.escape(error['message'])}</strong> {html.escape(error['remedy'])}</p>"
    return (
        f"<p>{len(facts['marks'])} marks were chosen among {facts['stages'][-1]['left']:,} places that passed every "
        f"filter. The objective is {facts['objective']:.3f}: what the marks show of the asset's directions, less what "
        "they cost. All figures below are shares of all directions.</p>"
    )


def _stages(stages: Iterable[Mapping[str, Any]]) -> str:
    rows, before, most = [], None, 1
    for one in stages:
        left = one["left"]
        before, most = (left, max(left, 1)) if before is None else (before, most)
        reason = one["dropped_because"] or ""
        gone = f"{before - left:,}" if before > left else ""
        rows.append(
            f"<tr><td>{html.escape(TITLES[one['stage']])}</td><td class='number'>{left:,}</td>"
            f"<td><meter min='0' max='{most}' value='{left}'></meter></td><td class='number'>{gone}</td>"
            f"<td>{html.escape(reason) if gone else ''}</td></tr>"
        )
        before = left
    head = "<tr><th>boxes that are</th><th>left</th><th></th><th>dropped</th><th>because</th></tr>"
    return f"<table>{head}{''.join(rows)}</table>"


def _figure(layer: Layer, picture: bytes) -> str:
    return (
        f"<figure>{_image(picture, layer.title)}<figcaption>"
        f"<span class='swatch' style='background:{layer.color}'></span>"
        f"{html.escape(layer.title)}: {len(layer.boxes):,}</figcaption></figure>"
    )


def _marks(marks: Sequence[Mapping[str, Any]], near: Sequence[bytes]) -> str:
    cards = []
    for number, (mark, picture) in enumerate(zip(marks, near, strict=True), 1):
        costs = sorted(mark["costs"].items(), key=lambda cost: -abs(cost[1]))
        if mark["beside_others"]:
            costs.append(("beside_others", mark["beside_others"]))
        rows = [("adds, seen from all around", mark["covers"])]
        rows += [(TERMS.get(name, "beside other marks"), -value) for name, value in costs if abs(value) >= LEAST]
        body = "".join(f"<tr><td>{name}</td><td class='number'>{value:+.4f}</td></tr>" for name, value in rows)
        cards.append(
            f"<article>{_image(picture, f'Mark {number}')}<div><strong>{number}</strong>, {mark['width']:.3g} wide, in "
            f"{mark['views']} of the 24 views<table>{body}</table></div></article>"
        )
    return f"<div class='marks'>{''.join(cards)}</div>" if cards else ""


def _refused(refused: Iterable[Mapping[str, Any]]) -> str:
    rows = "".join(
        f"<tr><td>{', '.join(f'{value:.3g}' for value in one['center'])}</td><td class='number'>{one['width']:.3g}</td>"
        f"<td>{html.escape(one['because'])}</td></tr>"
        for one in refused
    )
    return f"<table><tr><th>at</th><th>width</th><th>could not be cut because</th></tr>{rows}</table>"


def _image(picture: bytes, text: str) -> str:
    return (
        f"<img alt='{html.escape(text, quote=True)}' src='data:image/png;base64,{base64.b64encode(picture).decode()}'>"
    )
