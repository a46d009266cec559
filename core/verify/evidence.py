"""A page for people about one verification: everything that was found, in one file that needs no network."""

import base64
import html
import shlex
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

Pairs = Iterable[tuple[str, str]]

# A file may say any amount of anything: that much of each of its texts is shown, and as many lines of a table.
MOST_LETTERS, MOST_ROWS = 2000, 200
# Kinds of characters that are not seen, or that turn the order of others; of these the scripts that need joiners, and
# text in lines, keep some.
UNSEEN, KEPT = {"Cc", "Cf", "Cn", "Co", "Cs", "Zl", "Zp"}, "\t\n\u200c\u200d"

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
STYLE = """
:root { color-scheme: light dark; --ink: #1b1f24; --soft: #59636e; --line: #d1d9e0; --ground: #fff; --raised: #f6f8fa;
  --good: #116329; --bad: #a40e26 }
@media (prefers-color-scheme: dark) { :root { --ink: #e6edf3; --soft: #9198a1; --line: #3d444d; --ground: #0d1117;
  --raised: #161b22; --good: #56d364; --bad: #ff7b72 } }
* { box-sizing: border-box }
body { margin: 0 auto; padding: 1.5rem 1rem 3rem; max-width: 52rem; background: var(--ground); color: var(--ink);
  font: 1rem/1.5 system-ui, sans-serif; overflow-wrap: anywhere }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0 0 .25rem }
h2 { font-size: 1.15rem; margin: 2.25rem 0 .5rem; padding-top: .75rem; border-top: 1px solid var(--line) }
h3 { font-size: 1rem; margin: 0 0 .25rem }
p { margin: .5rem 0 }
section, h1 { overflow: clip }
bdi { white-space: pre-wrap }
.soft { color: var(--soft) }
.good { color: var(--good); font-weight: 600 }
.bad { color: var(--bad); font-weight: 600 }
table { border-collapse: collapse; width: 100% }
th, td { text-align: left; vertical-align: top; padding: .3rem .75rem .3rem 0; border-bottom: 1px solid var(--line) }
th { font-weight: 400; color: var(--soft); width: 11rem }
tr:last-child > * { border-bottom: 0 }
code { font: .9em/1.4 ui-monospace, monospace }
pre { white-space: pre-wrap; background: var(--raised); border: 1px solid var(--line); border-radius: .4rem;
  padding: .6rem .75rem }
article { display: flex; flex-wrap: wrap; gap: 1rem; padding: 1rem 0; border-bottom: 1px solid var(--line);
  break-inside: avoid }
article:last-child { border: 0 }
figure { margin: 0; flex: 1 1 16rem; max-width: 22rem }
figure img { display: block; max-width: 100%; max-height: 22rem; border: 1px solid var(--line); border-radius: .4rem }
article > div { flex: 2 1 18rem }
@media (max-width: 34rem) { th { width: 7.5rem } }
@media print { :root { color-scheme: light; --ink: #000; --soft: #444; --line: #bbb; --ground: #fff; --raised: #fff;
  --good: #116329; --bad: #a40e26 } body { padding: 0; max-width: none; font-size: 10pt } h2 { break-after: avoid } }
"""

STATES = {
    "trusted": ("good", "trusted: they fit the file, and a trusted certificate signed them"),
    "valid": ("good", "valid: they fit the file; whether their certificate can be trusted is not known here"),
    "expired": ("bad", "expired: they fit the file, and their certificate was out of date"),
    "tampered": ("bad", "tampered: they are not those of this file, or were changed"),
    "absent": ("soft", "absent"),
}
CREDENTIAL_NAMES = {"issuer": "signed by", "name": "certificate of", "source_type": "source type"}
LABEL_NAMES = {"source_type": "source type", "system_version": "version of the system"}


def evidence_page(
    report: Mapping[str, Any],
    pictures: Sequence[bytes],
    filename: str,
    moment: datetime | None = None,
    heights: Sequence[bytes] = (),
) -> bytes:
    """A self-contained HTML page, UTF-8: no script, nothing that is fetched, for screens, phones and paper.

    Whatever the suspect file says is shown as text: characters that are not seen, or turn the order of others, by
    their number.

    Args:
        report: ``meshmark.verification/1``.
        pictures: a PNG of each of its marks.
        filename: of the suspect file.
        moment: of the verification, with its time zone; left out of the page where it is not known.
        heights: a PNG of the relief of each mark over the original; none without one.
    """
    parts = [
        _head(report, filename),
        _file(report, filename, moment),
        _texts(report),
        _marks(report["marks"], pictures),
        _original(report["original"], heights),
        _label(report["label"]),
        _credentials(report["credentials"]),
        _warnings(report["warnings"]),
        _meaning(report),
    ]
    title = f"Verification of {_plain(filename)}"
    page = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(part for part in parts if part)
        + "\n</body>\n</html>\n"
    )
    return page.encode()


def _plain(text: str) -> str:
    """A text of the suspect file with everything in it seen, and no longer than a page bears."""
    seen = "".join(
        f"[U+{ord(letter):04X}]" if unicodedata.category(letter) in UNSEEN and letter not in KEPT else letter
        for letter in text[:MOST_LETTERS]
    )
    return seen if len(text) <= MOST_LETTERS else f"{seen}… ({len(text):,} characters in all)"


def _said(text: object) -> str:
    """A text of somebody else's in HTML: it turns nothing beside it."""
    return f"<bdi>{html.escape(_plain(str(text)))}</bdi>"


def _table(rows: Pairs) -> str:
    """Names and values in HTML, one a line."""
    lines = list(rows)
    shown = [f'<tr><th scope="row">{name}</th><td>{value}</td></tr>' for name, value in lines[:MOST_ROWS]]
    more = f'<p class="soft">and {len(lines) - MOST_ROWS:,} more</p>' if len(lines) > MOST_ROWS else ""
    return f"<table>{''.join(shown)}</table>{more}"


def _section(title: str, body: str) -> str:
    return f"<section>\n<h2>{title}</h2>\n{body}\n</section>"


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def _head(report: Mapping[str, Any], filename: str) -> str:
    texts, found = report["texts"], report["found"]
    asked = "No text was asked for"
    if found is not None:
        count = f"{len(found)} of {_count(len(texts), 'text')} found"
        asked = f'<span class="{"good" if found else "bad"}">{count}</span>'
    read = _count(len(report["marks"]), "mark")
    return f"<h1>Verification of {_said(filename)}</h1>\n<p>{asked}; {read} read.</p>"


def _file(report: Mapping[str, Any], filename: str, moment: datetime | None) -> str:
    file, engine = report["file"], report["engine"]
    rows = [
        ("name", _said(filename)),
        ("SHA-256", f"<code>{html.escape(file['sha256'])}</code>"),
        ("size", _count(file["bytes"], "byte")),
        ("format", _said(file["format"])),
        ("read by", f"Meshmark {_said(engine['version'])}"),
    ]
    if moment is not None:
        rows.append(("verified at", f"{moment.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC"))
    rows.append(("took", f"{report['timings']['all']:.1f} s"))
    return _section("The file", _table(rows))


def _texts(report: Mapping[str, Any]) -> str:
    found = report["found"]
    if found is None:
        return ""
    words = {True: '<span class="good">found</span>', False: '<span class="bad">not found</span>'}
    return _section("Texts asked for", _table((_said(text), words[text in found]) for text in report["texts"]))


def _marks(marks: Sequence[Mapping[str, Any]], pictures: Sequence[bytes]) -> str:
    if not marks:
        return _section("Marks", "<p>None was read.</p>")
    shown = [
        _mark(number, mark, picture) for number, (mark, picture) in enumerate(zip(marks, pictures, strict=True), 1)
    ]
    note = '<p class="soft">Places and lengths are in the coordinates of the file.</p>'
    return _section("Marks", "\n".join([note, *shown]))


def _mark(number: int, mark: Mapping[str, Any], picture: bytes) -> str:
    rows = [("read as", _said(mark["text"]))]
    if mark["known"] is not None:
        rows += [("text", _said(mark["known"])), ("likeness", f"{mark['likeness']:.2f} of 1")]
    rows += [
        ("confidence", f"{mark['confidence']:.2f} of 1"),
        ("pictures", f"{mark['votes']} ({', '.join(mark['pictures'])})"),
    ]
    if mark["pixel"] is not None:
        rows.append(("place", f"pixel {_numbers(mark['pixel'])}"))
    else:
        rows += [
            ("place", _numbers(mark["center"])),
            ("reads along", _numbers(mark["right"])),
            ("faces", _numbers(mark["normal"])),
            ("length", f"{mark['length']:.4g}"),
        ]
    return _article(f"Mark {number}", "seen head-on", picture, rows)


def _article(title: str, seen: str, picture: bytes, rows: Pairs) -> str:
    """A picture with a table beside it."""
    source = base64.b64encode(picture).decode()
    return (
        f'<article>\n<figure><img alt="{title}, {seen}" src="data:image/png;base64,{source}"></figure>\n'
        f"<div><h3>{title}</h3>{_table(rows)}</div>\n</article>"
    )


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def _original(original: Mapping[str, Any] | None, heights: Sequence[bytes]) -> str:
    if original is None:
        return ""
    file, marks = original["file"], original["marks"]
    rows = [
        ("SHA-256", f"<code>{html.escape(file['sha256'])}</code>"),
        ("size, format", f"{_count(file['bytes'], 'byte')}, {_said(file['format'])}"),
        ("residual", f"{100 * original['residual']:.2g} % of the radius, of the nearest four fifths"),
        ("covered", f"{100 * original['covered']:.0f} % of the original"),
        ("scale", f"{original['scale']:.6g}"),
    ]
    if original["is_asset"] is not None:
        there = sum(mark["present"] is True for mark in marks)
        color = "good" if there else "bad"
        rows += [
            ("marks of the job", f'<span class="{color}">{there} of {len(marks)} are there</span>'),
            ("marked by the job", "this very file" if original["is_asset"] else "another file than this original"),
            ("made by the job", "this very suspect file" if original["is_result"] else "another file than the suspect"),
        ]
    note = '<p class="soft">Red stands out of the original\'s surface, blue lies in it; grey: nothing to compare.</p>'
    name = "Relief of mark {}" if original["is_asset"] is None else "Relief of the job's mark {}"
    first = 1 if original["is_asset"] is None else 0  # above, marks are counted from 1; the job's have an id
    shown = [
        _height(name.format(mark["index"] + first), mark, picture) for mark, picture in zip(marks, heights, strict=True)
    ]
    return _section("Against the original", "\n".join([_table(rows), *([note] if shown else []), *shown]))


def _height(title: str, mark: Mapping[str, Any], picture: bytes) -> str:
    words = {
        True: '<span class="good">there</span>',
        False: '<span class="bad">not there</span>',
        None: "too little of the surface is left to say",
    }
    rows = [("text", _said(mark["text"]))]
    if mark["standing_out"] is not None:
        rows.append(("result", words[mark["present"]]))
    if mark["correlation"] is not None:
        rows.append(("likeness to the artwork", f"{mark['correlation']:.2f} of 1"))
    if mark["standing_out"] is not None:
        rows.append(("stands out", f"{100 * mark['standing_out']:.0f} % of its box"))
    rows += [("height", f"{mark['height']:.3g}"), ("surface", f"{100 * mark['surface']:.0f} % of its box")]
    return _article(title, "its height over the original", picture, rows)


def _label(label: Mapping[str, Any] | None) -> str:
    rows: list[tuple[str, str]] = []
    for name, value in (label or {}).items():
        if name != "aigc" and value:
            rows.append((LABEL_NAMES.get(name, name), _said(value)))
    for one in (label or {}).get("aigc", []):
        fields = one["fields"] if one["fields"] is not None else {"as it is": one["text"]}
        rows += [(f"AIGC: {_said(name)}", _said(value)) for name, value in fields.items()]
    said = _table(rows) if rows else "<p>They say nothing.</p>"
    return _section("Metadata", f'{said}\n<p class="soft">Anybody can write and delete these.</p>')


def _counted(texts: Iterable[str]) -> Iterable[str]:
    """Each of some texts once, with their number where there are several."""
    return (text if number == 1 else f"{text} ({number:,} times)" for text, number in Counter(texts).items())


def _credentials(credentials: Mapping[str, Any] | None) -> str:
    if credentials is None:
        return ""
    state = credentials["state"]
    judged = f'<span class="{STATES[state][0]}">{STATES[state][1]}</span>'
    rows = [("state", judged), ("failures", _said(", ".join(credentials["codes"])))]
    for name in ("issuer", "name", "time", "generator", "title", "source_type"):
        rows.append((CREDENTIAL_NAMES.get(name, name), _said(credentials[name] or "")))
    rows += [
        ("actions", _said(", ".join(credentials["actions"]))),
        ("marks", _said(", ".join(_counted(credentials["marks"])))),
    ]
    return _section("Content Credentials", _table((name, value) for name, value in rows if value != _said("")))


def _warnings(warnings: Sequence[Mapping[str, Any]]) -> str:
    if not warnings:
        return ""
    rows = ((_said(one["code"]), f"{_said(one['message'])} {_said(one['remedy'])}") for one in warnings)
    return _section("Warnings", _table(rows))


def _meaning(report: Mapping[str, Any]) -> str:
    asked = " ".join(f"--text={shlex.quote(text)}" for text in report["texts"])
    if report["original"] is not None:
        asked += " --original ORIGINAL" + (" --report-of REPORT" if report["original"]["is_asset"] is not None else "")
    return _section(
        "What this page proves",
        "<p>It says what Meshmark read in the file of this SHA-256. It is not signed: whoever has the file can check "
        "it, by its SHA-256 and by</p>\n"
        f"<pre><code>{_said(f'meshmark verify FILE {asked}'.strip())}</code></pre>\n"
        "<p>It does not prove who made the file, nor who put the marks or the metadata there: anybody can. Marks that "
        "were not found do not prove that there were none: they can have been too small to be read, or removed.</p>",
    )
