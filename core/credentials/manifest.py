"""Statements of a result's Content Credentials, from its report (C2PA 2.2: actions in 18.14, own assertions in 6.2)."""

from collections.abc import Mapping
from typing import Any

Json = dict[str, Any]

MARKS = "org.meshmark.marks"
MARKS_SCHEMA = "meshmark.marks/1"
PARENT = "asset"  # label of the ingredient within one definition
OPENED, CREATED, EDITED, METADATA = "c2pa.opened", "c2pa.created", "c2pa.edited", "c2pa.edited.metadata"


def definition(report: Mapping[str, Any], title: str, media_type: str, *, preview: bool = False) -> Json:
    """Definition of a manifest, as the library takes it.

    The asset was opened and edited; where the report declares how it came about, it was created so, and edited.

    Args:
        report: ``meshmark.report/1``.
        title: name of the file that is signed.
        media_type: of that file.
        preview: it is the preview model, which may lack some of the marks.

    Raises:
        LookupError, TypeError: that is no such report.
    """
    source_type = (report["label"] or {}).get("source_type")
    program = {"name": "Meshmark", "version": report["engine"]["version"]}
    began = (
        {"action": CREATED, "digitalSourceType": source_type}
        if source_type
        else {"action": OPENED, "parameters": {"ingredientIds": [PARENT]}}
    )
    edited = {"action": METADATA if report["parameters"]["metadata_only"] else EDITED, "softwareAgent": program}
    parent = {
        "title": "asset",
        "format": "application/octet-stream",
        "relationship": "parentOf",
        "instance_id": f"urn:sha256:{report['asset']['sha256']}",
        "label": PARENT,
    }
    return {
        "claim_generator_info": [program],
        "title": title,
        "format": media_type,
        "ingredients": [] if source_type else [parent],
        "assertions": [
            {"label": "c2pa.actions.v2", "data": {"actions": [began, edited]}},
            {"label": MARKS, "data": _marks(report, preview)},
        ],
    }


def _marks(report: Mapping[str, Any], preview: bool) -> Json:
    """The assertion about the marks: both files' hashes, and each mark's words and place, in world coordinates."""
    made = report["preview_model" if preview else "model"]
    return {
        "schema": MARKS_SCHEMA,
        "asset": {"sha256": report["asset"]["sha256"]},
        "model": {"sha256": made["sha256"]},
        "watermarks": [
            {
                "text": mark["text"],
                "center": _point(mark["center"]),
                "right": _point(mark["right"]),
                "up": _point(mark["up"]),
                "width": float(mark["size"][0]),
                "height": float(mark["size"][1]),
                "relief": float(mark["relief"]),
            }
            for mark in report["watermarks"]
            if not preview or mark["id"] in made["watermarks"]
        ],
    }


def _point(values: list[float]) -> Json:
    # By name: readers take an array of small whole numbers for bytes.
    return dict(zip("xyz", map(float, values), strict=True))
