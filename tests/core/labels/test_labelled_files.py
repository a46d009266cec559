"""Labels in files that the whole engine writes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.errors import ErrorCode, MeshmarkError
from core.gltf.document import Document
from core.gltf.scene import scene_of
from core.labels.packet import aigc_labels, packets, property_of, said
from core.labels.profiles import Label
from core.parameters import Parameters
from core.pipeline import watermark
from tests.validator import validate

SPOT = (Path(__file__).parents[2] / "data" / "spot.glb").read_bytes()
DECLARED = {"creator": "Example Ltd", "identifier": "47", "aigc": {"content_producer": "Example Ltd"}}


def labelled(data: bytes = SPOT, **asked: Any) -> tuple[bytes, dict[str, Any]]:
    parameters = Parameters.model_validate({"evaluate": "none", "count": 1} | asked)
    parameters.require_content(logo=False)
    result = watermark(data, parameters, preview=False)
    return result.model, result.report


@pytest.mark.parametrize("label", list(Label))
def test_a_file_with_a_label_is_a_valid_one(label: Label) -> None:
    model, report = labelled(label=label, declaration=DECLARED, metadata_only=True)
    found = validate(model)["issues"]["messages"]
    before = {message["code"] for message in validate(SPOT)["issues"]["messages"]}
    assert {message["code"] for message in found} - before <= {"UNSUPPORTED_EXTENSION"}
    [extension] = [message for message in found if message["code"] == "UNSUPPORTED_EXTENSION"]
    assert "KHR_xmp_json_ld" in extension["message"]
    assert (report["label"] is None, report["watermarks"], report["metrics"]) == (False, [], None)


def test_a_mark_and_a_label_come_together_and_say_the_same() -> None:
    model, report = labelled(label="eu", declaration=DECLARED)
    [mark] = report["watermarks"]
    assert mark["lines"] == ["AI", "GENERATED"]
    asset = Document.from_glb(model).json["asset"]
    assert asset["copyright"].endswith("AI GENERATED")
    [packet] = packets(Document.from_glb(model).json)
    assert said(property_of(packet, "Iptc4xmpExt:DigitalSourceType")) == report["label"]["source_type"]


def test_a_label_alone_leaves_the_shape_and_all_else_as_it_is() -> None:
    model, _ = labelled(label="cn", metadata_only=True)
    before, after = scene_of(SPOT), scene_of(model)
    np.testing.assert_array_equal(before.surface.positions, after.surface.positions)
    for name in ("meshes", "materials", "images", "nodes"):
        assert before.document.json.get(name) == after.document.json.get(name)
    assert before.document.binary == after.document.binary


def test_a_label_alone_is_not_written_where_none_is_asked_for() -> None:
    with pytest.raises(MeshmarkError, match="asks for no label"):
        watermark(SPOT, Parameters(metadata_only=True), preview=False)


def test_files_of_other_formats_are_labelled_as_glb() -> None:
    model, _ = labelled(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", label="cn", metadata_only=True)
    assert len(aigc_labels(Document.from_glb(model).json)) == 1


def test_the_preset_for_provenance_labels_and_the_others_do_so_on_request_only() -> None:
    assert labelled(text="SAMPLE", preset="provenance")[1]["label"]["source_type"] is None
    assert labelled(text="SAMPLE")[1]["label"] is None
    assert labelled(text="SAMPLE", declaration={"source_type": "digitalCreation"})[1]["label"]["source_type"]


def test_the_same_request_gives_the_same_bytes() -> None:
    asked: dict[str, Any] = {"label": "cn", "declaration": DECLARED, "metadata_only": True}
    assert labelled(**asked)[0] == labelled(**asked)[0]


def test_a_file_marked_and_labelled_before_has_one_label_still() -> None:
    first, _ = labelled(label="cn", declaration=DECLARED, metadata_only=True)
    platform = {"aigc": {"content_propagator": "Shop", "propagate_id": "1"}}
    second, report = labelled(first, label="cn", declaration=platform, metadata_only=True)
    [(holder, key)] = aigc_labels(Document.from_glb(second).json)
    fields = json.loads(holder[key])
    assert (fields["ContentProducer"], fields["ContentPropagator"]) == ("Example Ltd", "Shop")
    assert report["label"]["aigc"] == "filled"


def test_labels_of_the_input_stay_where_none_is_asked_for() -> None:
    first, _ = labelled(label="cn", declaration=DECLARED, metadata_only=True)
    again, report = labelled(first, text="SAMPLE")
    assert packets(Document.from_glb(again).json) == packets(Document.from_glb(first).json)
    assert report["label"] is None


def test_what_the_rule_asks_for_and_nobody_gave_is_told() -> None:
    [notice] = labelled(label="us-ca", metadata_only=True)[1]["warnings"]
    assert notice["code"] == "incomplete_label"
    assert "creator, system, system_version, created, identifier" in notice["message"]


def test_broken_metadata_fails_before_anything_is_published() -> None:
    document = Document.from_glb(SPOT)
    document.json["extensions"] = {"KHR_xmp_json_ld": {"packets": 1}}
    published: list[str] = []
    for asked in ({"metadata_only": True}, {"count": 1}):
        parameters = Parameters.model_validate({"label": "us-ca", "evaluate": "none"} | asked)
        with pytest.raises(MeshmarkError) as error:
            watermark(document.to_glb(), parameters, publish=lambda name, _: published.append(name))
        assert error.value.code is ErrorCode.MALFORMED_FILE
    assert published == []
