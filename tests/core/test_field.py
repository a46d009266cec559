"""What users of neighbouring tools ran into, from the file to the marks that a viewer draws of it.

Situations that one module decides are tested with that module; ``FIELD`` says where each is.
"""

import ast
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.choices import Evaluate
from core.formats.admission import admit, document_of
from core.gltf.document import Document
from core.gltf.scene import scene_of
from core.parameters import Parameters
from core.pipeline import Result, watermark
from tests.core.formats.samples import STL_BINARY
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder
from tests.core.gltf.edited import colors_of_corners
from tests.drawn import undrawn
from tests.glb_file import GlbFile
from tests.residue import touched

TESTS = Path(__file__).parents[1]
ASKED = Parameters(text="HOLD", count=4, size=2.0, evaluate=Evaluate.NONE)
INWARDS = np.array(CUBE_FACES).reshape(-1, 3)[:, ::-1].ravel().tolist()
Json = dict[str, Any]

# Where each situation is tested: the number that it has in the notes of the project's field study, file and test.
FIELD = {
    1: "core/test_judged.py::test_a_glb_of_any_kind_keeps_nothing_back_and_shows_every_mark",
    2: "core/test_field.py::test_an_stl_that_is_inside_out_shows_its_marks",
    4: "core/test_field.py::test_in_a_room_to_look_into_the_marks_are_seen_from_where_it_is_looked_into",
    6: "core/test_field.py::test_a_box_that_nobody_sees_carries_no_marks",
    8: "core/test_field.py::test_letters_on_unlit_materials_have_a_colour_that_shows",
    10: "core/test_field.py::test_a_body_that_is_called_blended_but_is_opaque_carries_the_marks",
    11: "core/test_field.py::test_what_stands_in_a_case_of_glass_is_marked_and_not_the_glass",
    12: "core/formats/test_obj_zip.py::test_materials_whose_names_are_in_a_code_page_are_told_apart_and_named",
    14: "core/formats/test_obj_zip.py::test_a_texture_is_found_whatever_code_page_names_it",
    17: "core/formats/test_pack.py::test_files_whose_names_are_written_without_escapes_are_packed",
    19: "core/formats/test_obj.py::test_colours_of_any_range_stand_behind_the_coordinates",
    20: "core/formats/test_ply.py::test_colours_of_any_type_are_fractions_of_what_they_go_up_to",
    22: "core/formats/test_dae.py::test_a_body_in_skins_or_morphs_stays_in_bind_pose",
    25: "core/formats/test_dae.py::test_transparency_is_read_in_every_convention",
    27: "core/formats/test_dae.py::test_transparency_is_read_in_every_convention",
    29: "core/formats/test_stl.py::test_colours_of_viscam_are_read_blue_first_where_their_bit_says_so",
    30: "core/formats/test_ply.py::test_a_texture_that_is_not_in_the_upload_is_named",
    31: "core/formats/test_ply.py::test_the_texture_that_a_ply_names_is_drawn_where_the_archive_has_it",
    32: "core/formats/test_obj.py::test_the_polypaint_of_zbrush_is_read_without_its_mask",
    33: "core/formats/test_threemf.py::test_volumes_that_are_tools_of_prusa_slicer_are_left_out_and_said",
    35: "core/formats/test_threemf.py::test_attributes_that_slicers_paint_on_triangles_are_no_colours",
    36: "core/formats/test_threemf.py::test_objects_that_are_no_model_are_left_out_and_said",
    38: "core/test_field.py::test_what_is_hidden_far_away_changes_nothing",
    39: "core/test_field.py::test_what_is_hidden_far_away_changes_nothing",
    43: "core/gltf/test_validate.py::test_bytes_after_the_declared_length_are_ignored",
    44: "core/gltf/test_validate.py::test_an_image_of_another_kind_with_a_fallback_is_carried_without_a_word",
    52: "core/formats/test_obj.py::test_a_normal_that_cannot_be_read_counts_as_absent",
    58: "core/gltf/test_validate.py::test_another_version_is_named_before_anything_that_differs_in_it",
    62: "core/gltf/test_validate.py::test_further_chunks_are_carried_with_a_warning_that_names_them",
    74: "core/test_field.py::test_no_level_of_detail_and_no_other_scene_keeps_a_clean_copy",
    78: "core/test_pipeline.py::test_letters_stand_out_by_the_same_share_of_their_height_however_long_the_text",
    82: "core/formats/test_stl.py::test_a_header_that_claims_no_triangle_is_corrected_where_the_bytes_fit_exactly",
}


def test_every_situation_is_tested_where_it_is_said_to_be() -> None:
    for place in FIELD.values():
        file, name = place.split("::")
        tree = ast.parse((TESTS / file).read_text())
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, place


def document(*parts: tuple[float, Json, list[int]], **nodes: Json) -> Document:
    """Boxes of half a side, a material and their triangles each, about the origin; ``n1`` adds to the second node."""
    builder = Builder()
    meshes = []
    for number, (half, _, faces) in enumerate(parts):
        meshes.append({"primitives": [{**builder.primitive(np.array(CUBE) * half, faces), "material": number}]})
    count = range(len(parts))
    return builder.document(
        meshes=meshes,
        nodes=[{"mesh": number, "name": f"part {number}"} | nodes.get(f"n{number}", {}) for number in count],
        scenes=[{"nodes": list(count)}],
        materials=[material for _, material, _ in parts],
    )


def marked(data: bytes, asked: Parameters = ASKED) -> tuple[Result, np.ndarray[Any, np.dtype[np.float64]]]:
    """The result, all marks of it drawn, and where they are."""
    result = watermark(data, asked, preview=False)
    marks = result.report["watermarks"]
    assert undrawn(result.model, marks, document_of(admit(data)).to_glb()) == []
    return result, np.array([mark["center"] for mark in marks])


def blended(alpha: float) -> Json:
    return {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.9, alpha]}}


def test_an_stl_that_is_inside_out_shows_its_marks() -> None:
    facets = [STL_BINARY[at : at + 50] for at in range(84, len(STL_BINARY), 50)]
    turned = b"".join(facet[:12] + facet[36:48] + facet[24:36] + facet[12:24] + facet[48:] for facet in facets)
    _, centers = marked(STL_BINARY[:84] + turned)
    assert np.abs(centers).max() > 0.95


def test_in_a_room_to_look_into_the_marks_are_seen_from_where_it_is_looked_into() -> None:
    """Its walls have one side each, which faces the table in it."""
    result, _ = marked(document((3.0, {}, INWARDS), (0.8, {}, CUBE_FACES)).to_glb())
    for mark in result.report["watermarks"]:
        at, normal = np.array(mark["center"]), np.array(mark["normal"])
        on_table = np.abs(at).max() < 1
        assert (at @ normal > 0) == on_table, "out of the table, and into the room"


def test_a_box_that_nobody_sees_carries_no_marks() -> None:
    _, centers = marked(document((1.0, {}, CUBE_FACES), (1.5, blended(0.0), CUBE_FACES)).to_glb())
    assert np.abs(centers).max() < 1.2


def test_letters_on_unlit_materials_have_a_colour_that_shows() -> None:
    material = {"pbrMetallicRoughness": {"baseColorFactor": [0.9, 0.9, 0.9, 1]}}
    plain = document((1.0, {**material, "extensions": {"KHR_materials_unlit": {}}}, CUBE_FACES))
    plain.json["extensionsUsed"] = ["KHR_materials_unlit"]
    result, _ = marked(plain.to_glb())
    assert all("KHR_materials_unlit" in each["extensions"] for each in GlbFile(result.model).entries("materials"))
    shown = colors_of_corners(scene_of(result.model)).reshape(-1, 3)
    assert shown.max() == pytest.approx(0.9), "the ground"
    assert np.abs(shown - 0.9).max() > 0.2, "the letters"


@pytest.mark.parametrize("material", [blended(1.0), blended(0.97), {**blended(1.0), "alphaMode": "MASK"}])
def test_a_body_that_is_called_blended_but_is_opaque_carries_the_marks(material: Json) -> None:
    knob = {"translation": [1.2, 0, 0]}
    result, centers = marked(document((1.0, material, CUBE_FACES), (0.25, {}, CUBE_FACES), n1=knob).to_glb())
    assert (centers[:, 0] < 1.1).mean() > 0.5
    assert "see_through_surface" not in [notice["code"] for notice in result.report["warnings"]]


def test_what_stands_in_a_case_of_glass_is_marked_and_not_the_glass() -> None:
    result, centers = marked(document((1.0, {}, CUBE_FACES), (1.6, blended(0.2), CUBE_FACES)).to_glb())
    assert np.abs(centers).max() < 1.2
    assert "see_through_surface" not in [notice["code"] for notice in result.report["warnings"]]


@pytest.mark.parametrize(
    "hidden",
    [{"scale": [0, 0, 0]}, {"extensions": {"KHR_node_visibility": {"visible": False}}}],
    ids=["scaled to nothing", "hidden"],
)
def test_what_is_hidden_far_away_changes_nothing(hidden: Json) -> None:
    alone, _ = marked(document((1.0, {}, CUBE_FACES)).to_glb())
    far = document((1.0, {}, CUBE_FACES), (1.0, {}, CUBE_FACES), n1={"translation": [5000, 0, 0], **hidden})
    far.json["extensionsUsed"] = ["KHR_node_visibility"]
    beside, _ = marked(far.to_glb())
    sizes = [[mark["size"] for mark in result.report["watermarks"]] for result in (alone, beside)]
    assert np.allclose(np.sort(sizes[0], axis=0), np.sort(sizes[1], axis=0), rtol=0.05)


def test_no_level_of_detail_and_no_other_scene_keeps_a_clean_copy() -> None:
    whole = document((1.0, {}, CUBE_FACES), (1.0, {}, CUBE_FACES), (1.0, {}, CUBE_FACES))
    nodes = whole.json["nodes"]
    nodes[0]["extensions"] = {"MSFT_lod": {"ids": [1]}}
    whole.json["scenes"] = [{"nodes": [0]}, {"nodes": [2]}]
    whole.json["extensionsUsed"] = ["MSFT_lod"]
    # One accessor each is told from the others by its bytes: the level lies within the whole, the other scene is it.
    data = whole.to_glb()
    result, _ = marked(data)
    before = GlbFile(data)
    assert len(touched(GlbFile(result.model), before)) == len(list(before.primitives()))
