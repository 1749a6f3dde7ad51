"""A run in somebody's own geometry shows the meshes that the environment's folder keeps."""

import dataclasses

import numpy as np
import pytest
from recording_content import still
from scripted_flight import scenario

from gslcosim.contract.participant import Episode
from gslcosim.environment.model import VisualMesh
from gslcosim.environment.store import MESHES_FILE, load_environment, save_environment
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.services import build_core
from gslcosim.runtime.setup import RunSetup
from gslcosim_data.environment_view import record_environment
from gslcosim_services.recorder.scene import MESH_ALPHA, SHELL_ALPHA

RACK = ("rack", (5.0, 4.0, 0.0), (6.0, 6.0, 3.0))
PART, SHELL = "/room/geometry/inside/0_Roof_2", "/room/geometry/shell/0_Roof_2"


@pytest.fixture
def roof():
    return VisualMesh.of(
        "Roof #2",
        np.array([[0.0, 0.0, 6.0], [15.0, 0.0, 6.0], [7.5, 10.0, 5.0], [7.5, 10.0, 5.9]]),
        np.array([[0, 1, 2], [0, 1, 3]]),
        (1.0, 0.5, 0.0, 1.0),
    )


@pytest.fixture
def recorded(make_room, tmp_path):
    """Record the start of a run in an environment that is read from its folder; return both places."""

    def run(*, meshes):
        folder, run_dir = tmp_path / "environment", RunDir(tmp_path / "run")
        save_environment(dataclasses.replace(make_room(obstacles=[RACK]), meshes=meshes), folder)
        setup = RunSetup(
            run_dir=run_dir, scenario=scenario(), environment_dir=folder, environment=load_environment(folder)
        )
        core = build_core("recorder", setup)
        core.reset(Episode(seed=0))
        core.close()
        return folder, run_dir.recording

    return run


def test_the_meshes_of_the_folder_are_drawn_in_place_of_boxes(recorded, rows_of, roof):
    folder, recording = recorded(meshes=(roof,))
    assert (folder / MESHES_FILE).is_file()
    np.testing.assert_allclose(still(recording, PART, "Mesh3D:vertex_positions"), roof.vertices_m)
    assert still(recording, PART, "Mesh3D:triangle_indices") == [[0, 1, 2]]
    assert "/room/obstacles" not in rows_of(recording)


def test_what_lies_at_a_side_of_the_room_is_seen_through(recorded, roof):
    _, recording = recorded(meshes=(roof,))
    assert still(recording, SHELL, "Mesh3D:triangle_indices") == [[0, 1, 3]]
    inside, shell = (still(recording, entity, "Mesh3D:albedo_factor")[0] & 0xFF for entity in (PART, SHELL))
    assert (inside, shell) == (MESH_ALPHA, SHELL_ALPHA)


def test_a_run_looks_like_its_environment(recorded, rows_of, roof, tmp_path):
    folder, recording = recorded(meshes=(roof,))
    view = tmp_path / "view.rrd"
    record_environment(load_environment(folder, with_meshes=True), view)
    for component in ("Mesh3D:vertex_positions", "Mesh3D:albedo_factor"):
        assert still(recording, PART, component) == still(view, PART, component)
