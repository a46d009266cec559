"""Results in other formats: written, and read again by our own readers and by those of others."""

import io
import zipfile
from collections import Counter
from typing import Any

import lib3mf
import numpy as np
import pytest
import trimesh

from core.arrays import Float
from core.budgets import DEFAULT_BUDGETS
from core.choices import FileFormat
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.formats.format import Format, Written
from core.formats.marked import Marked
from core.formats.registry import WRITERS, export_format
from core.formats.zip_write import zip_of
from core.geometry.grouping import float_words, group_rows
from core.gltf.scene import Scene, flatten
from core.metrics.topology import topology
from tests.core.formats.samples import (
    DAE,
    GLB,
    OBJ_ZIP,
    OFF,
    PLY_ASCII,
    SAMPLES,
    STL_BINARY,
    png,
    threemf_cube,
    threemf_model,
    zipped,
)
from tests.core.gltf.builder import CUBE, CUBE_FACES, simple

# Numbers that 32 bits do not hold, as texts have them.
TENTHS = b"".join(b"v %.1f %.2f %.7f\n" % (x * 0.1, y * 12345.67, z * 0.1234567) for x, y, z in CUBE)
GROUPED = (
    b"mtllib m.mtl\n" + TENTHS + b"vt 0.25 0.125\nvt 1 0\nvt 1 1\n"
    b"o bottom\ng first\nusemtl red\nf 1/1 2/2 4/3\nf 1/1 4/3 3/2\n"
    b"o top\ng second third\ns 1\nusemtl wood\nf 5/1 7/2 8/3 6/1\n"
    b"usemtl red\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
)
GROUPED_ZIP = zipped(
    {
        "a/box.obj": GROUPED,
        "a/m.mtl": "newmtl red\nKd 1 0 0\nKs 0.3 0.3 0.3\nNs 20\n"
        "newmtl wood\nKa 1 1 1\nmap_Kd wood.png\nbump Bump.TGA\n",
        "a/wood.png": png(90, 60, 30),
        "a/bump.tga": b"a picture of another kind",
        "a/preview.png": png(1, 1, 1),
        "read me.txt": b"not a part of the model",
    }
)
COLORED = 'pid="9" p1="0" p2="1" p3="0"'
ASSEMBLY = zipped(
    {
        "_rels/.rels": "<Relationships><Relationship Target='/3D/3dmodel.model' Id='a' "
        "Type='http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel'/></Relationships>",
        "3D/3dmodel.model": threemf_model(
            '<basematerials id="8"><base name="Brass &amp; steel" displaycolor="#C0A060"/></basematerials>'
            '<m:colorgroup id="9"><m:color color="#FF0000"/><m:color color="#00FF00"/></m:colorgroup>'
            f'<object id="1" name="one &lt;1&gt;" pid="8" pindex="0">{threemf_cube()}</object>'
            f'<object id="2" name="two">{threemf_cube(COLORED)}</object>'
            '<object id="3" name="pair"><components><component objectid="1"/>'
            '<component objectid="2" transform="1 0 0 0 1 0 0 0 1 4.1 0.3 0"/></components></object>',
            '<item objectid="3" transform="0 1 0 -1 0 0 0 0 1 10.7 0 0"/><item objectid="1"/><item objectid="3"/>',
            'unit="inch"',
        ).replace("<resources>", '<metadata name="Title">Cubes &amp; more</metadata><resources>', 1),
        "Metadata/thumbnail.png": png(1, 2, 3),
    }
)


def marked(data: bytes) -> Marked:
    """A result that no mark was cut into."""
    admitted = admit(data)
    scene = flatten(document_of(admitted))
    return Marked(scene, scene, None, admitted.format, admitted.source, DEFAULT_BUDGETS, {})


def written(data: bytes, wanted: Format) -> Written:
    return WRITERS[wanted](marked(data))


def as_file(result: Written) -> bytes:
    return zip_of(result.files) if len(result.files) > 1 else next(iter(result.files.values()))


def read(result: Written) -> Scene:
    return flatten(document_of(admit(as_file(result))))


def corners(scene: Scene) -> Float:
    """(F, 9) of the triangles, in an order of their own."""
    surface = scene.surface
    found = surface.to_world(surface.positions)[surface.faces]
    return np.unique(np.sort(found.round(5), axis=1).reshape(-1, 9), axis=0)


def lines(data: bytes, word: str) -> list[str]:
    return [line for line in data.decode().splitlines() if line.startswith(f"{word} ")]


@pytest.mark.parametrize("wanted", [*WRITERS])
@pytest.mark.parametrize("sample", ["glb", "obj", "stl-binary", "ply-ascii", "off", "3mf", "dae"])
def test_a_result_is_read_again_as_the_same_surface(sample: str, wanted: Format) -> None:
    if wanted is Format.OFF and sample != "off":
        return  # nobody can ask for it
    before, result = marked(SAMPLES[sample]), written(SAMPLES[sample], wanted)
    after = read(result)
    assert len(after.surface.faces) == len(before.scene.surface.faces)
    unit = {"millimeter": 1000.0, "meter": 1.0, None: 1.0}[result.unit]
    if wanted is Format.THREEMF:
        unit = 1.0 if result.unit else 1e-3  # which our reader turns to metres
    assert after.surface.scale * unit == pytest.approx(before.scene.surface.scale, rel=1e-6)
    counts = [topology(scene.surface) for scene in (before.scene, after)]
    assert counts[0].nonmanifold_edges == counts[1].nonmanifold_edges
    assert counts[0].boundary_edges == counts[1].boundary_edges
    assert as_file(result) == as_file(written(SAMPLES[sample], wanted)), "the same bytes"


@pytest.mark.parametrize("sample", ["obj", "stl-binary", "ply-ascii", "off", "3mf"])
def test_coordinates_stay_what_they_were_in_the_format_that_came(sample: str) -> None:
    data = SAMPLES[sample]
    assert np.array_equal(corners(read(written(data, admit(data).format.inner))), corners(marked(data).scene))


def test_an_obj_keeps_every_digit_of_its_vertices_and_its_own_groups_and_files() -> None:
    result = written(GROUPED_ZIP, Format.OBJ)
    assert set(result.files) == {"a/box.obj", "a/m.mtl", "a/wood.png", "a/bump.tga"}
    before = zipfile.ZipFile(io.BytesIO(GROUPED_ZIP))
    assert all(result.files[name] == before.read(name) for name in result.files if name != "a/box.obj")
    text = result.files["a/box.obj"]
    given = {tuple(map(float, line.split()[1:])) for line in lines(GROUPED, "v")}
    assert {tuple(map(float, line.split()[1:])) for line in lines(text, "v")} == given
    assert lines(text, "mtllib") == ["mtllib m.mtl"]
    assert lines(text, "o") + lines(text, "g") == ["o bottom", "o top", "g first", "g second third"]
    found = Counter[tuple[str, str, str]]()
    state = {"o": "", "usemtl": "", "s": ""}
    for line in text.decode().splitlines():
        word, _, rest = line.partition(" ")
        if word in state:
            state[word] = rest
        elif word == "f":
            found[state["o"], state["usemtl"], state["s"]] += 1
    assert found == {("bottom", "red", ""): 2, ("top", "wood", "1"): 2, ("top", "red", "1"): 8}
    assert "vt 0.25 0.125" in lines(text, "vt")


def test_a_3mf_keeps_parts_instances_unit_metadata_and_colours() -> None:
    result = written(ASSEMBLY, Format.THREEMF)
    assert (result.unit, result.up) == ("inch", "z")
    assert "thumbnails" in result.left_out, "which show the unmarked model"
    model = zipfile.ZipFile(io.BytesIO(as_file(result))).read("3D/3dmodel.model").decode()
    assert '<metadata name="Title">Cubes &amp; more</metadata>' in model
    assert model.count("<mesh>") == 2
    assert model.count("<components>") == 1
    assert model.count("<item ") == 3
    assert 'transform="0 1 0 -1 0 0 0 0 1 10.7 0 0"' in model
    assert 'transform="1 0 0 0 1 0 0 0 1 4.1 0.3 0"' in model
    again, before = read(result), marked(ASSEMBLY).scene
    assert [node.label for node in again.nodes] == [node.label for node in before.nodes]
    assert {drawn.primitive.material.name for drawn in again.primitives} >= {"Brass & steel"}
    assert sum("COLOR_0" in drawn.primitive.attributes for drawn in again.primitives) == 2


def test_lib3mf_finds_nothing_to_complain_of() -> None:
    textured = written(OBJ_ZIP, Format.THREEMF)
    for data in (as_file(written(ASSEMBLY, Format.THREEMF)), as_file(textured), as_file(written(GLB, Format.THREEMF))):
        model = lib3mf.get_wrapper().CreateModel()
        reader = model.QueryReader("3mf")
        reader.SetStrictModeActive(True)
        reader.ReadFromBuffer(data)
        assert not [reader.GetWarning(number) for number in range(reader.GetWarningCount())]
        meshes, triangles = model.GetMeshObjects(), 0
        while meshes.MoveNext():
            triangles += meshes.GetCurrentMeshObject().GetTriangleCount()
        assert triangles >= 12


@pytest.mark.parametrize(("wanted", "kind"), [(Format.STL, "stl"), (Format.PLY, "ply"), (Format.OFF, "off")])
def test_trimesh_reads_the_same_volume(wanted: Format, kind: str) -> None:
    source = {Format.STL: STL_BINARY, Format.PLY: PLY_ASCII, Format.OFF: OFF}[wanted]
    mesh: Any = trimesh.load(io.BytesIO(as_file(written(source, wanted))), file_type=kind, force="mesh")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(8)


def test_trimesh_reads_the_textures_of_an_obj() -> None:
    result = written(GROUPED_ZIP, Format.OBJ)
    files = {name.removeprefix("a/"): io.BytesIO(data) for name, data in result.files.items()}
    resolver: Any = trimesh.resolvers.ZipResolver(files)
    scene: Any = trimesh.load(files["box.obj"], file_type="obj", resolver=resolver)
    pictures = [mesh.visual.material.image for mesh in scene.geometry.values() if hasattr(mesh.visual, "material")]
    assert any(picture is not None and picture.getpixel((0, 0))[:3] == (90, 60, 30) for picture in pictures)


def test_an_stl_has_the_label_in_its_header_and_no_header_passes_for_text() -> None:
    asset = marked(STL_BINARY)
    words = {"a": "http://cv.iptc.org/newscodes/digitalsourcetype/trainedAlgorithmicMedia", "b": "(c) COLOR=RGBA"}
    labelled = Marked(asset.scene, asset.scene, None, asset.format, asset.source, DEFAULT_BUDGETS, words)
    data = as_file(WRITERS[Format.STL](labelled))
    assert data[:80] == b"meshmark trainedAlgorithmicMedia".ljust(80)
    assert admit(data).format is Format.STL
    assert len(data) == 84 + 50 * 12


def test_a_glb_for_printers_is_in_millimetres_with_z_up() -> None:
    metres = simple([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 5]], [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]).to_glb()
    result = written(metres, Format.STL)
    assert (result.unit, result.up) == ("millimeter", "z")
    mesh: Any = trimesh.load(io.BytesIO(as_file(result)), file_type="stl")
    assert mesh.bounds.tolist() == [[0, -5000, 0], [2000, 0, 3000]]
    assert mesh.volume > 0
    assert (written(metres, Format.PLY).unit, written(metres, Format.PLY).up) == ("meter", "y")


def test_a_ply_keeps_its_doubles_and_names_the_properties_that_it_loses() -> None:
    rows = b"".join(b"%.1f %.2f %.7f 7\n" % (x * 0.1, y * 12345.67, z * 0.1234567) for x, y, z in CUBE)
    faces = b"".join(b"3 %d %d %d\n" % tuple(CUBE_FACES[at : at + 3]) for at in range(0, 36, 3))
    head = "ply\nformat ascii 1.0\nelement vertex 8\n" + "".join(f"property double {axis}\n" for axis in "xyz")
    head += "property float quality\nelement face 12\nproperty list uchar int vertex_indices\nend_header\n"
    result = written(head.encode() + rows + faces, Format.PLY)
    assert result.left_out == ["properties: quality"]
    mesh: Any = trimesh.load(io.BytesIO(as_file(result)), file_type="ply", process=False)
    given = np.array([[float(word) for word in line.split()[:3]] for line in rows.decode().splitlines()])
    assert {tuple(point) for point in mesh.vertices.tolist()} == {tuple(point) for point in given.tolist()}


def test_solids_that_touch_stay_apart_as_they_were() -> None:
    moved = np.asarray(CUBE) + np.array([2, 2, 0])
    two = simple([*CUBE, *moved.tolist()], [*CUBE_FACES, *(np.asarray(CUBE_FACES) + 8).tolist()])
    for wanted in (Format.OBJ, Format.THREEMF, Format.PLY):
        mesh = read(written(two.to_glb(), wanted)).surface
        rows = group_rows(float_words(mesh.positions))
        assert rows.max() + 1 == 14
        assert len(np.unique(mesh.faces)) == 16, "two vertices at each point of the edge that they share"


@pytest.mark.parametrize(
    ("asked", "data", "wanted"),
    [
        (FileFormat.GLB, OFF, None),
        (FileFormat.SAME, GLB, None),
        (FileFormat.SAME, SAMPLES["gltf"], None),
        (FileFormat.SAME, OBJ_ZIP, Format.OBJ),
        (FileFormat.SAME, OFF, Format.OFF),
        (FileFormat.THREEMF, DAE, Format.THREEMF),
    ],
)
def test_the_same_format_is_that_of_the_model_itself(asked: FileFormat, data: bytes, wanted: Format | None) -> None:
    assert export_format(asked, admit(data).format) is wanted


def test_a_dae_does_not_come_back_as_one() -> None:
    with pytest.raises(MeshmarkError) as caught:
        export_format(FileFormat.SAME, Format.DAE)
    assert caught.value.code is ErrorCode.UNSUPPORTED_FORMAT
    assert "DAE" in caught.value.message


def test_names_that_no_file_may_have_are_made_harmless() -> None:
    named = simple([[0, 0, 0], [2, 0, 0], [0, 3, 0]], [0, 1, 2], name="a\nf 1 1 1 \ud800 <&>\x01")
    named.json["materials"] = [{"name": "red\nillum 9", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}]
    named.json["meshes"][0]["primitives"][0]["material"] = 0
    files = written(named.to_glb(), Format.OBJ).files
    assert lines(files["model.obj"], "f") == ["f 1 2 3"]
    assert lines(files["model.mtl"], "illum") == ["illum 2"]
    assert len(read(written(named.to_glb(), Format.THREEMF)).surface.faces) == 1


def test_a_size_that_no_printer_knows_is_refused_in_words() -> None:
    huge = simple(np.diag([0.0, 2e38, 3e38]), [0, 1, 2]).to_glb()
    with pytest.raises(MeshmarkError, match="32-bit"):
        written(huge, Format.STL)


def test_coordinates_far_from_the_origin_come_back_to_the_last_digit() -> None:
    far = b"".join(b"v %.3f %.3f %.3f\n" % (x + 4567890.123, y - 54321.987, z) for x, y, z in CUBE)
    far += b"".join(b"f %d %d %d\n" % tuple(corner + 1 for corner in CUBE_FACES[at : at + 3]) for at in range(0, 36, 3))
    text = written(far, Format.OBJ).files["model.obj"]
    assert {tuple(map(float, line.split()[1:])) for line in lines(text, "v")} == {
        tuple(map(float, line.split()[1:])) for line in lines(far, "v")
    }


def test_vertex_colours_stay_colours_of_vertices() -> None:
    painted = b"".join(b"v %d %d %d %.1f 0.4 1\n" % (x, y, z, 0.2 * (x + 2)) for x, y, z in CUBE)
    painted += b"".join(
        b"f %d %d %d\n" % tuple(corner + 1 for corner in CUBE_FACES[at : at + 3]) for at in range(0, 36, 3)
    )
    result = written(painted, Format.OBJ)
    assert set(result.files) == {"model.obj"}, "no material"
    colors = {tuple(map(float, line.split()[4:])) for line in lines(result.files["model.obj"], "v")}
    assert len(colors) == 2
    assert {round(red * 255) for red, _, _ in colors} == {51, 153}
    mesh: Any = trimesh.load(io.BytesIO(as_file(written(painted, Format.PLY))), file_type="ply", process=False)
    assert set(map(tuple, mesh.visual.vertex_colors.tolist())) == {(51, 102, 255, 255), (153, 102, 255, 255)}


def test_a_sheared_part_of_a_3mf_stays_where_it_is() -> None:
    item = '<item objectid="1" transform="1 0.5 0 0 1 0 0 0.25 2 3 4 5"/>'
    data = zipped({"3D/3dmodel.model": threemf_model(f'<object id="1" name="c">{threemf_cube()}</object>', item)})
    result = written(data, Format.THREEMF)
    assert (
        'transform="1 0.5 0 0 1 0 0 0.25 2 3 4 5"'
        in zipfile.ZipFile(io.BytesIO(as_file(result))).read("3D/3dmodel.model").decode()
    )
    assert np.allclose(corners(read(result)), corners(marked(data).scene), atol=1e-9)


def test_a_flattened_part_of_a_3mf_is_told_to_be_left_out() -> None:
    items = '<item objectid="1"/><item objectid="1" transform="1 0 0 0 1 0 0 0 0 9 0 0"/>'
    data = zipped({"3D/3dmodel.model": threemf_model(f'<object id="1" name="c">{threemf_cube()}</object>', items)})
    result = written(data, Format.THREEMF)
    assert result.left_out == ["parts without a volume"]
    assert len(read(result).surface.faces) == 12
