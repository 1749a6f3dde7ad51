"""Laws of rooms from geometry: any boxes, in any order of triangles, and holes of any place."""

import re

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from gslcosim.base.errors import ScenarioError
from gslcosim.environment.grid_kernels import find_reachable_cells
from gslcosim.environment.model import Box, Cell
from gslcosim.environment.openings import voxelize
from gslcosim.scenario.models.scenario import WindSpec
from gslcosim_formats.geometry.solid_geometry import geometry_from_files
from gslcosim_formats.scenario_keys import GeometrySpec

SIZE_M = (4.0, 3.0, 2.0)
CELL_M = 0.25
OPENINGS = [
    {"name": "inlet", "kind": "inlet", "box": {"min_m": (0, 0, 0), "max_m": (0, 3, 2)}},
    {"name": "outlet", "kind": "outlet", "box": {"min_m": (4, 0, 0), "max_m": (4, 3, 2)}},
]

# Boxes apart from the openings, so that none closes one; a hundredth of a cell keeps clear of last digits.
lengths = st.integers(2, 120).map(lambda n: n / 100)


@st.composite
def boxes(draw):
    size_m = [draw(lengths) for _ in range(3)]
    low_m = [
        draw(st.integers(30, round(100 * (length - size - 0.3)))) / 100
        for length, size in zip(SIZE_M, size_m, strict=True)
    ]
    return tuple(low_m), tuple(round(low + size, 2) for low, size in zip(low_m, size_m, strict=True))


def shell():
    return trimesh.creation.box(bounds=[(0, 0, 0), SIZE_M])


def room_of(path, meshes, openings=OPENINGS):
    files = []
    for i, mesh in enumerate(meshes):
        (path / f"part_{i}.stl").write_bytes(mesh.export(file_type="stl"))
        files.append(f"part_{i}.stl")
    spec = GeometrySpec.model_validate({"files": files, "openings": openings})
    return geometry_from_files(spec, WindSpec(cell_m=CELL_M), base_dir=path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("geometry")


@pytest.mark.slow
@settings(max_examples=12)
@given(corners=st.lists(boxes(), min_size=1, max_size=4))
def test_boxes_as_meshes_have_the_cells_of_boxes(folder, corners):
    room = room_of(folder, [shell(), *(trimesh.creation.box(bounds=bounds) for bounds in corners)])
    solids = [Box(name=f"box_{i}", kind="obstacle", min_m=low, max_m=high) for i, (low, high) in enumerate(corners)]
    expected = find_reachable_cells(~voxelize(solids, room.grid), room.openings, room.grid)
    assert ((room.occupancy != Cell.SOLID) == expected).all()


@settings(max_examples=15)
@given(corners=boxes(), seed=st.integers(0, 99), angle_rad=st.floats(0, 6))
def test_the_order_and_direction_of_triangles_have_no_meaning(folder, corners, seed, angle_rad):
    body = trimesh.creation.box(bounds=corners)
    turn = trimesh.transformations.rotation_matrix(angle_rad, (1, 2, 3), point=body.centroid)
    body.apply_transform(turn)
    before = room_of(folder, [shell(), body])
    rng = np.random.default_rng(seed)
    faces = rng.permutation(body.faces)
    faces = np.array([np.roll(face, rng.integers(3))[:: rng.choice((-1, 1))] for face in faces])
    after = room_of(folder, [shell(), trimesh.Trimesh(body.vertices, faces, process=False)])
    assert (after.occupancy == before.occupancy).all()


def holed(hole_m, *, side_m):
    """Return a room whose floor has a triangular hole with two sides of one length at a right angle."""
    x, y = hole_m
    hole = [(x, y), (x + side_m, y), (x, y + side_m)]
    # The floor around the hole: from its corners to those of the room.
    corners = [(0, 0), (4, 0), (4, 3), (0, 3)]
    rim = [
        (corners[0], corners[1], hole[1]), (corners[0], hole[1], hole[0]), (corners[1], corners[2], hole[1]),
        (corners[2], hole[2], hole[1]), (corners[2], corners[3], hole[2]), (corners[3], hole[0], hole[2]),
        (corners[3], corners[0], hole[0]),
    ]  # fmt: skip
    floor = np.array([[(*corner, 0.0) for corner in triangle] for triangle in rim])
    whole = shell()
    whole.update_faces(~(whole.triangles[:, :, 2] == 0).all(axis=1))
    triangles = np.concatenate((whole.triangles, floor))
    return trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), process=False)


places = st.tuples(st.integers(40, 240), st.integers(40, 150)).map(lambda xy: (xy[0] / 100, xy[1] / 100))


@settings(max_examples=15)
@given(hole_m=places)
def test_one_missing_triangle_is_found_at_its_place(folder, hole_m):
    with pytest.raises(ScenarioError) as error:
        room_of(folder, [holed(hole_m, side_m=1.0)])
    found = re.search(r"hole of about (\S+) x (\S+) m near \[(.*?), (.*?), (.*?)\] m beside part_0", str(error.value))
    width, depth, x, y, z = map(float, found.groups())
    assert (x, y) == pytest.approx(np.add(hole_m, 0.4), abs=0.4)
    assert z == pytest.approx(0.0, abs=2 * CELL_M)
    assert CELL_M <= depth <= width <= 1.0


@settings(max_examples=15)
@given(hole_m=places)
def test_a_hole_that_holds_no_face_of_a_cell_does_not_leak(folder, hole_m):
    room = room_of(folder, [holed(hole_m, side_m=CELL_M)])
    assert room.grid.shape == (16, 12, 8)
    assert (room.occupancy != Cell.SOLID).all()
