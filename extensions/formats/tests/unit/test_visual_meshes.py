"""Meshes to be looked at: in the environment folder as glTF, in the STL instead of the boxes made from them."""

import dataclasses
import io

import numpy as np
import pytest
import trimesh

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.model import VisualMesh, WindFrames, with_wind
from gslcosim.environment.store import load_environment, save_environment
from gslcosim.environment.visual_meshes import encode_glb, load_visual_meshes
from gslcosim.scenario.models.scenario import BoxSpec, LayoutSpec, WindSpec
from gslcosim_formats.export import build_stl


def mesh(name, shape, rgba=(1.0, 0.2, 0.0, 1.0)):
    return VisualMesh.of(name, shape.vertices, shape.faces, rgba)


TANK = mesh("tank", trimesh.creation.cylinder(radius=0.4, height=1.2).apply_translation((1.5, 1.0, 0.6)))
# No axis of it is another's image, so exchanged axes would show.
PANE = mesh("pane of glass", trimesh.creation.box(bounds=[(2.0, 1.0, 0.2), (2.1, 1.5, 1.9)]), (0.2, 0.4, 0.6, 0.4))


@pytest.fixture
def environment():
    shelf = BoxSpec(name="shelf", min_m=(1.0, 1.0, 0.0), max_m=(2.0, 1.3, 1.1))
    room = build_layout(LayoutSpec(size_m=(4.0, 3.0, 2.0), obstacles=(shelf,)), WindSpec(cell_m=0.5))
    room = dataclasses.replace(room, meshes=(TANK, PANE))
    return with_wind(room, WindFrames(velocity_m_s=np.zeros((1, *room.grid.shape, 3), np.float32)))


def check_same(found, expected):
    assert [each.name for each in found] == [each.name for each in expected]
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a.vertices_m, b.vertices_m)
        np.testing.assert_array_equal(a.faces, b.faces)
        assert a.rgba == b.rgba


def test_a_folder_gives_back_the_meshes_it_was_saved_with(environment, tmp_path):
    save_environment(environment, tmp_path / "room")
    assert (tmp_path / "room" / "visual.glb").read_bytes() == encode_glb(environment.meshes)
    check_same(load_environment(tmp_path / "room", with_meshes=True).meshes, environment.meshes)
    assert load_environment(tmp_path / "room").meshes == ()


def test_other_programs_find_the_file_upright_and_in_its_colours(environment):
    """Height is y in glTF."""
    scene = trimesh.load_scene(io.BytesIO(encode_glb(environment.meshes)), file_type="glb")
    pane = scene.geometry["pane of glass"]
    np.testing.assert_allclose(pane.bounds, [(2.0, 0.2, -1.5), (2.1, 1.9, -1.0)], atol=1e-6)
    assert pane.visual.material.baseColorFactor.tolist() == [51, 102, 153, 102]


@pytest.mark.parametrize("n_kept", [0, 20, -100])
def test_a_damaged_file_is_named(environment, tmp_path, n_kept):
    path = tmp_path / "visual.glb"
    path.write_bytes(encode_glb(environment.meshes)[:n_kept])
    with pytest.raises(EnvironmentDataError, match=r"visual\.glb: expected whole glTF with 2 meshes, was \d+ bytes"):
        load_visual_meshes(path, ["tank", "pane of glass"])


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(EnvironmentDataError, match=r"visual\.glb: expected meshes, was missing"):
        load_visual_meshes(tmp_path / "visual.glb", ["tank"])


def test_in_stl_meshes_stand_for_the_obstacles(environment):
    text = build_stl(environment).decode()
    names = [line.removeprefix("solid ") for line in text.splitlines() if line.startswith("solid ")]
    assert names == [box.name for box in environment.boxes if box.kind != "obstacle"] + ["tank", "pane of glass"]
    assert "shelf" in build_stl(dataclasses.replace(environment, meshes=())).decode()


def test_a_mesh_in_stl_has_its_triangles_turned_outwards(environment):
    text = build_stl(environment).decode()
    tank = text[text.index("solid tank") : text.index("endsolid tank")] + "endsolid tank\n"
    found = trimesh.load_mesh(io.BytesIO(tank.encode()), file_type="stl_ascii")
    np.testing.assert_allclose(found.triangles, TANK.vertices_m[TANK.faces], atol=1e-6)
    assert found.volume == pytest.approx(np.pi * 0.4**2 * 1.2, rel=0.01)
