"""Settings of slicers beside a 3MF model: volumes of it that are their tools and not parts of the model."""

import re
from dataclasses import dataclass, field

from core.budgets import Budgets
from core.errors import MeshmarkError
from core.formats.archive import Archive
from core.formats.assembly import dropped
from core.formats.xml import Handlers, Tally, parse_xml
from core.notices import Notice

# Object types of the core specification that are printed beside the model or not at all.
OBJECT_TYPES = {"support": "supports", "solidsupport": "supports", "other": "auxiliary objects"}

# PrusaSlicer's Metadata/Slic3r_PE_model.config and its like, Bambu Studio's and Orca's Metadata/model_settings.config.
SETTINGS = re.compile(r"metadata/(?:\w*_model|model_settings)\.config", re.IGNORECASE)
_KINDS = {
    "negativevolume": "negative volumes",
    "negativepart": "negative volumes",
    "parametermodifier": "modifiers",
    "modifierpart": "modifiers",
    "supportenforcer": "support enforcers",
    "supportblocker": "support blockers",
}


@dataclass(eq=False)
class Tools:
    """Volumes that are no parts of the model; each value is their kind, in the plural.

    Attributes:
        ranges: by object: the first and last triangle of a volume in its mesh, and its kind.
        parts: by object and the object that a component of it means.
    """

    ranges: dict[str, list[tuple[int, int, str]]] = field(default_factory=dict)
    parts: dict[tuple[str, str], str] = field(default_factory=dict)


def read_tools(archive: Archive, budgets: Budgets, tally: Tally, warnings: list[Notice]) -> Tools:
    """The tools in a package; settings that cannot be read are warned of, since tools may then pass for parts.

    Args:
        archive: the package.
        budgets: bounds the settings' XML.
        tally: of the XML parts of the package.
        warnings: settings that are not read are appended.
    """
    tools = Tools()
    for name in archive.names:
        if SETTINGS.fullmatch(name):
            try:
                _Reader(tools).read(archive.read(name), budgets, tally)
            except MeshmarkError as error:
                warnings.append(dropped(f"The slicer's settings in the 3MF are not read: {error.message}"))
    return tools


class _Reader:
    """Fills :class:`Tools` from the settings of one slicer."""

    def __init__(self, tools: Tools) -> None:
        self._tools = tools
        self._object = ""
        self._range: tuple[int, int] | None = None  # of the volume being read

    def read(self, data: bytes, budgets: Budgets, tally: Tally) -> None:
        parse_xml(data, "The list of volumes", budgets, Handlers(self._start, self._end), tally=tally)

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if name == "object":
            self._object = attributes.get("id", "")
        elif name == "part" and (kind := _kind(attributes.get("subtype", ""))):
            self._tools.parts[self._object, attributes.get("id", "")] = kind
        elif name == "volume":
            first, last = attributes.get("firstid", ""), attributes.get("lastid", "")
            self._range = (int(first[:9]), int(last[:9])) if first.isdecimal() and last.isdecimal() else None
        elif name == "metadata" and self._range is not None:
            key, value = attributes.get("key"), attributes.get("value", "")
            kind = _kind(value) if key == "volume_type" else "modifiers" if (key, value) == ("modifier", "1") else None
            if kind is not None:
                self._tools.ranges.setdefault(self._object, []).append((*self._range, kind))
                self._range = None  # older releases say it twice

    def _end(self, name: str) -> None:
        if name == "volume":
            self._range = None


def _kind(text: str) -> str | None:
    return _KINDS.get(text.lower().replace("_", ""))
