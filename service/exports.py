"""Endings and media types of results in other formats than GLB, by their first bytes: the engine wrote them."""

from typing import NamedTuple

HEAD = 64  # bytes that tell the kind


class Kind(NamedTuple):
    """The ending of a file's name and its media type."""

    ending: str
    media_type: str


# Those that have no registered media type go by the names that programs use.
KINDS = {
    "3mf": Kind(".3mf", "model/3mf"),
    "zip": Kind(".zip", "application/zip"),
    "ply": Kind(".ply", "model/ply"),
    "off": Kind(".off", "model/off"),
    "stl": Kind(".stl", "model/stl"),
}


def kind_of(head: bytes) -> Kind:
    """The kind of a file that begins with ``head``; a 3MF is a ZIP that begins with the list of its types."""
    if head.startswith(b"PK"):
        return KINDS["3mf" if b"[Content_Types].xml" in head else "zip"]
    if head.startswith(b"ply"):
        return KINDS["ply"]
    return KINDS["off" if head.startswith((b"OFF", b"COFF")) else "stl"]
