"""Files of thieves in the asset's own materials."""

from pathlib import Path

import numpy as np
import pytest

from core.arrays import Bool
from core.gltf.accessors import read_values
from core.gltf.scene import Scene, flatten, scene_of
from core.lab.attacks.fill import filled_flat, grown
from core.lab.attacks.redrawn import redrawn
from core.lab.plain import Mesh, plain
from tests.core.gltf.builder import Builder, grid

DATA = Path(__file__).parents[3] / "data"


@pytest.fixture(scope="module")
def spot() -> Scene:
    return scene_of((DATA / "spot.glb").read_bytes())


def uvs(scene: Scene) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """(F, 3, 2) at the corners of all faces of a scene with one primitive."""
    [drawn] = scene.primitives
    return np.asarray(read_values(scene.document, drawn.primitive.attributes["TEXCOORD_0"])[drawn.triangles])


def placed(scene: Scene) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """(F, 3, 3) the corners of all faces."""
    return np.asarray(scene.surface.positions[scene.surface.faces])


def patch(mesh: Mesh) -> Bool:
    """(F,) a face in the middle of the flank and those round it."""
    middle = mesh.positions[mesh.faces].mean(axis=1)
    start = np.zeros(len(mesh.faces), dtype=bool)
    start[np.abs(middle - [6.0, -2.0, -2.0]).sum(axis=1).argmin()] = True
    return grown(mesh.faces, start, 2)


def test_what_a_thief_leaves_alone_keeps_its_texture(spot: Scene) -> None:
    mesh = plain(spot.surface)
    after = redrawn(spot, mesh, np.arange(len(mesh.faces)))
    np.testing.assert_array_equal(uvs(after), uvs(spot))
    np.testing.assert_allclose(placed(after), placed(spot), atol=1e-5)
    assert after.primitives[0].primitive.material.texture is not None
    moved = redrawn(spot, Mesh(mesh.positions * [1.0, 0.5, 1.0], mesh.faces), np.arange(len(mesh.faces)))
    np.testing.assert_array_equal(uvs(moved), uvs(spot))


def test_a_new_patch_goes_on_in_the_texture_round_it(spot: Scene) -> None:
    mesh = plain(spot.surface)
    new = patch(mesh)
    before, after = uvs(spot), uvs(redrawn(spot, mesh, np.where(new, -1, np.arange(len(mesh.faces)))))
    np.testing.assert_array_equal(after[~new], before[~new])
    rim = np.isin(mesh.faces[new], mesh.faces[~new])
    np.testing.assert_allclose(after[new][rim], before[new][rim], atol=1e-6)
    assert not rim.all()
    # The texture lies evenly there, so that harmonic values are near the true ones.
    assert np.abs(after[new] - before[new]).max() < 0.01


def test_the_lid_of_a_hole_has_the_corners_of_its_rim(spot: Scene) -> None:
    mesh = plain(spot.surface)
    lidded, source = filled_flat(mesh, patch(mesh))
    assert (source < 0).any()
    after = redrawn(spot, lidded, source)
    found = uvs(after)[source < 0].reshape(-1, 2)
    rim = uvs(spot)[source[source >= 0]].reshape(-1, 2)
    assert np.abs(found[:, None] - rim[None]).sum(axis=2).min(axis=1).max() < 1e-6


def test_letters_of_their_own_material_get_that_of_the_ground_and_the_colours_round_them() -> None:
    positions, faces = grid(6)
    middle = positions[faces].mean(axis=1)
    letter = (np.abs(middle - [3, 3, 0]) < 1).all(axis=1)
    builder = Builder()
    white, ground = np.ones((len(positions), 4)), np.full((len(positions), 4), 0.25)
    primitives = [
        builder.primitive(positions, faces[which], COLOR_0=builder.accessor(color)) | {"material": number}
        for number, (which, color) in enumerate(((~letter, ground), (letter, white)))
    ]
    document = builder.document(meshes=[{"primitives": primitives}], materials=[{"name": "cloth"}, {"name": "ink"}])
    scene = flatten(document)
    mesh = plain(scene.surface)
    new = scene.surface.face_primitive == 1
    after = redrawn(scene, mesh, np.where(new, -1, np.arange(len(new))))
    [drawn] = after.primitives
    assert len(drawn.triangles) == len(new)
    assert after.document.json["materials"][drawn.primitive.material.index] == {"name": "cloth"}
    colors = read_values(after.document, drawn.primitive.attributes["COLOR_0"])
    np.testing.assert_allclose(colors, 0.25, atol=1e-6)
