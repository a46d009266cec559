"""The stage that writes the result in another format beside its GLB."""

from dataclasses import replace

from core.formats.admission import admit
from core.formats.format import Format, OutputFile
from core.formats.marked import Marked
from core.formats.registry import WRITERS, export_format
from core.formats.zip_write import zip_of
from core.labels.packet import packets, property_of, said
from core.labels.write import AIGC_PROPERTY, RIGHTS, SOURCE_TYPE
from core.notices import Notice, NoticeCode
from core.stages import Asset, Exported, Output, Run

# Statements of a label by the full names of their properties.
_PROPERTIES = {
    SOURCE_TYPE: "http://iptc.org/std/Iptc4xmpExt/2008-02-29/DigitalSourceType",
    AIGC_PROPERTY: "http://www.tc260.org.cn/ns/AIGC/1.0/AIGC",
    RIGHTS: "http://purl.org/dc/elements/1.1/rights",
}


def with_export(asset: Asset, output: Output, run: Run) -> Output:
    """The result with the export that was asked for beside the GLB, published.

    Raises:
        MeshmarkError: ``unsupported_format`` where the upload's own format is asked for, and is not written.
    """
    wanted = export_format(run.request.parameters.format, asset.format)
    if wanted is None:
        return output
    edit = None
    if output.embossed is not None:
        edit = asset.analysis.with_file_winding(output.embossed.mesh.edit())
    source = admit(asset.data, run.request.budgets).source
    marked = Marked(output.scene, asset.scene, edit, asset.format, source, run.request.budgets, _statements(output))
    written = WRITERS[wanted](marked)
    # An OBJ always comes in an archive, so that whoever asks for one always finds it there.
    is_zip = wanted is Format.OBJ or len(written.files) > 1
    data = zip_of(written.files) if is_zip else next(iter(written.files.values()))
    if written.left_out:
        run.notices.append(
            Notice(
                NoticeCode.LEFT_OUT_OF_EXPORT,
                f"The {wanted.upper()} leaves out what the GLB has: {', '.join(written.left_out)}.",
                "Take the GLB where these matter.",
            )
        )
    run.publish("export", data)
    file = OutputFile(wanted.archived if is_zip else wanted, data)
    return replace(output, exported=Exported(file, written.unit, written.up, tuple(written.left_out)))


def _statements(output: Output) -> dict[str, str]:
    """The statements of the result's label, by their full names."""
    if output.label is None:
        return {}
    packet = packets(output.label.json)[output.label.packet]
    found = {full: said(property_of(packet, name)) for name, full in _PROPERTIES.items()}
    return {full: text for full, text in found.items() if text}
