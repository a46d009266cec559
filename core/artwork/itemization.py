"""Text to runs: pieces of a line in one direction, script and typeface, in the order in which they are seen."""

import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, groupby

from fontTools.unicodedata import script as script_of
from fontTools.unicodedata import script_extension
from uniseg.graphemecluster import grapheme_clusters

from core.artwork.bidi import visual_order
from core.artwork.installed import REGIONS, faces_for, general_faces, packages_for
from core.artwork.typeface import Typeface, default_face
from core.errors import ErrorCode, MeshmarkError

# Scripts whose letters touch, by joining or by a common headline.
JOINED = {"Adlm", "Arab", "Beng", "Chrs", "Deva", "Guru", "Mand", "Mani", "Modi", "Mong", "Newa", "Nkoo", "Ougr"}
JOINED |= {"Phag", "Phlp", "Rohg", "Shrd", "Sogd", "Sylo", "Syrc", "Tirh"}

_COMMON = ("Zyyy", "Zinh", "Zzzz")  # take the script of the text around them (UAX 24)
_WESTERN = ("Latn", "Grek", "Cyrl", *_COMMON)  # what the bundled font is for


@dataclass(frozen=True)
class Cluster:
    """A grapheme cluster and the script it is set in."""

    text: str
    script: str


@dataclass(frozen=True)
class Run:
    """A piece ``[start, stop)`` of a text, in one embedding level, script and typeface."""

    start: int
    stop: int
    level: int
    script: str
    face: Typeface


Piece = tuple[Cluster, Typeface]


@dataclass(frozen=True)
class FontChain:
    """The typefaces that a text is set in, chosen for each grapheme cluster.

    Attributes:
        language: of ideographs, a key of ``REGIONS``.
        own: the typeface that came with the request, which goes before all others.
    """

    language: str
    own: Typeface | None = None

    def candidates(self, cluster: Cluster) -> Iterator[Typeface]:
        """The typefaces that may have a cluster, best first; opened one by one as they are asked for."""
        if cluster.script in _WESTERN:
            yield default_face()
        for script in dict.fromkeys([cluster.script, *sorted(script_extension(cluster.text[0]))]):
            if script not in _COMMON:
                yield from faces_for(script, REGIONS[self.language])
        yield default_face()
        yield from general_faces(REGIONS[self.language])

    def choose(self, lines: list[list[Cluster]]) -> list[list[Piece]]:
        """The clusters of each line with their typefaces.

        A typeface serves for as long as it has whole runs of a script, so that joined letters stay together; then for
        as long as it has whole clusters. The one that came with the request serves wherever it can. A cluster that no
        typeface has whole, such as a letter with the mark of another script, is taken apart.

        Raises:
            MeshmarkError: ``missing_glyphs``, with every character that no typeface has.
        """
        chosen, missing = self.match(lines)
        if missing:
            raise _missing_glyphs(missing)
        return chosen

    def match(self, lines: list[list[Cluster]]) -> tuple[list[list[Piece]], list[Cluster]]:
        """As :meth:`choose`, with what no typeface has apart."""
        chosen: list[list[Piece]] = []
        missing: list[Cluster] = []
        last: Typeface | None = None
        for line in lines:
            pieces: list[Piece] = []
            for cluster, whole in self._by_runs(line, last):
                face = whole or self._first([cluster], last)
                found = [(cluster, face)] if face else [(part, self._first([part], last)) for part in _parts(cluster)]
                pieces += [(part, face) for part, face in found if face is not None]
                missing += [part for part, face in found if face is None]
                last = pieces[-1][1] if pieces else last
            chosen.append(pieces)
        return chosen, missing

    def _by_runs(self, line: list[Cluster], last: Typeface | None) -> Iterator[tuple[Cluster, Typeface | None]]:
        """The clusters of a line, each with the typeface that has all of its script's run, if there is one."""
        for script, group in groupby(line, key=lambda cluster: cluster.script):
            run = list(group)
            apart = self.own is not None and script not in JOINED
            whole = None if apart else self._first(run, last)
            last = whole or last
            yield from ((cluster, whole) for cluster in run)

    def _first(self, clusters: list[Cluster], last: Typeface | None) -> Typeface | None:
        """The request's typeface if it has all of these clusters, else the last one, else the first that has them."""
        before = [face for face in (self.own, last) if face is not None]
        faces = chain(before, self.candidates(clusters[0]))
        return next((face for face in faces if not any(face.lacks(cluster.text) for cluster in clusters)), None)


def language_of(text: str, language: str | None) -> str:
    """The language whose ideographs a text has, a key of ``REGIONS``: as given, else guessed from its letters.

    Kana are Japanese, hangul is Korean, bopomofo is of Taiwan; other texts are in simplified Chinese.
    """
    if language is not None:
        primary, *rest = language.split("-")
        if primary in ("ja", "ko"):
            return primary
        if primary in ("zh", "yue"):
            if {"HK", "MO"} & set(rest):
                return "zh-HK"
            return "zh-Hant" if {"Hant", "TW"} & set(rest) or primary == "yue" else "zh-Hans"
    scripts = set(map(script_of, text))
    for script, guess in (("Hira", "ja"), ("Kana", "ja"), ("Hang", "ko"), ("Bopo", "zh-Hant")):
        if script in scripts:
            return guess
    return "zh-Hans"


def clusters_of(text: str) -> list[Cluster]:
    """The grapheme clusters of a line, each with its script."""
    scripts = _scripts(text)
    clusters = []
    start = 0
    for piece in grapheme_clusters(text):
        clusters.append(Cluster(piece, scripts[start]))
        start += len(piece)
    return clusters


def runs_of(pieces: Sequence[Piece]) -> list[Run]:
    """The runs of a part of a line from left to right as displayed (UAX 9)."""
    owner = [piece for piece in pieces for _ in piece[0].text]

    def place(character: tuple[int, int]) -> tuple[int, str, int]:
        index, level = character
        cluster, face = owner[index]
        return level, cluster.script, id(face)

    runs = []
    for (level, script, _), group in groupby(visual_order(text_of(pieces)), key=place):
        indices = [index for index, _ in group]
        start, stop = min(indices), max(indices) + 1  # a run in visual order is contiguous in the text as well
        runs.append(Run(start, stop, level, script, owner[start][1]))
    return runs


def text_of(pieces: Sequence[Piece]) -> str:
    """The text of a part of a line."""
    return "".join(cluster.text for cluster, _ in pieces)


def _parts(cluster: Cluster) -> list[Cluster]:
    scripts = [(character, script_of(character)) for character in cluster.text]
    return [Cluster(character, cluster.script if script in _COMMON else script) for character, script in scripts]


def _scripts(text: str) -> list[str]:
    """The script of each character.

    Common and inherited ones take that of the letter before (or else after); of those that a few scripts share, such as
    the ideographic full stop, the first that the text has (UAX 24, script extensions). A closing bracket takes that of
    its opening one.
    """
    scripts: list[str] = [script_of(character) for character in text]
    strong = [script for script in scripts if script not in _COMMON]
    current = next(iter(strong), "Zyyy")
    opened: list[str] = []
    for index, (character, script) in enumerate(zip(text, scripts, strict=True)):
        category = unicodedata.category(character)
        shared = script_extension(character)
        if script not in _COMMON:
            current = script
        elif category == "Pe" and opened:
            current = opened.pop()
        elif shared.isdisjoint(_COMMON) and current not in shared and category[0] != "M":
            current = next((other for other in strong if other in shared), current)
        if category == "Ps":
            opened.append(current)
        scripts[index] = current
    return scripts


def _missing_glyphs(missing: list[Cluster]) -> MeshmarkError:
    characters = sorted({cluster.text for cluster in missing})
    listed = ", ".join(f"{character} (U+{ord(character):04X})" for character in characters)
    scripts = {script_of(character) for character in characters}
    packages = sorted({package for script in scripts for package in packages_for(script)})
    install = f"install the Debian package {' or '.join(packages)}, " if packages else ""
    return MeshmarkError(
        ErrorCode.MISSING_GLYPHS,
        f"No font has an outline for {listed}.",
        f"Leave these characters out, {install}or send a font that has them.",
    )
