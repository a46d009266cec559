"""Machine-readable labels of a suspect file: its XMP packet, China's label, its copyright."""

from typing import Any

from core.labels.packet import aigc_labels, as_aigc, packet_of_asset, packets, property_of, said
from core.labels.write import PROPERTIES, SOURCE_TYPE
from core.verify.report import AigcLabel, FileLabel


def read_label(document: dict[str, Any]) -> FileLabel | None:
    """Statements of a glTF's JSON about the whole file; None where it makes none.

    Raises:
        MeshmarkError: ``malformed_file`` where its metadata contradicts itself.
    """
    number = packet_of_asset(document)
    packet = {} if number is None else packets(document)[number]
    copyright_ = document.get("asset", {}).get("copyright")
    statements = {name: said(property_of(packet, written)) for name, (written, _) in PROPERTIES.items()}
    label = FileLabel(
        source_type=said(property_of(packet, SOURCE_TYPE)),
        aigc=[_aigc(holder[key]) for holder, key in aigc_labels(document)],
        copyright=copyright_ if isinstance(copyright_, str) and copyright_ else None,
        **statements,
    )
    return label if any(value for _, value in label) else None


def _aigc(value: Any) -> AigcLabel:
    fields = as_aigc(value)
    known = None if fields is None else {str(name): str(one) for name, one in fields.items()}
    return AigcLabel(fields=known, text=value if isinstance(value, str) and fields is None else None)
