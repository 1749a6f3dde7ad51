"""The mesh is a closed one: faces in order, normals outward, volumes right, boundaries where the patches are."""

import numpy as np
import pytest

from gslcosim.flow import Inlet, MovingWall, Outlet, SlipWall
from gslcosim.flow.domain import build_domain
from gslcosim_formats.openfoam.case import WALLS, build_polymesh

CELL_M = 0.5
SHAPE = (6, 5, 4)  # three different side lengths
INLET = Inlet(min_m=(0, 0, 0), max_m=(0, 1, 1), velocity_m_s=(1, 0, 0))
OUTLET = Outlet(min_m=(3, 1.5, 0.5), max_m=(3, 2.5, 2))


def mesh_of(free, *patches):
    return build_polymesh(build_domain(free, CELL_M, [INLET, OUTLET, *patches]))


@pytest.fixture
def room():
    free = np.ones(SHAPE, bool)
    free[2:4, 1:3, :2] = False
    return free


def area_vectors_m2(mesh):
    a, b, c, d = (mesh.points_m[mesh.faces[:, corner]] for corner in range(4))
    return 0.5 * np.cross(c - a, d - b)


def test_inner_faces_are_in_upper_triangular_order(room):
    mesh = mesh_of(room)
    owners = mesh.owners[: len(mesh.neighbours)]
    assert np.all(owners < mesh.neighbours)
    pairs = list(zip(owners.tolist(), mesh.neighbours.tolist()))
    assert pairs == sorted(set(pairs))


def test_the_faces_of_a_cell_close_it_and_enclose_its_volume(room):
    mesh = mesh_of(room)
    areas_m2 = area_vectors_m2(mesh)
    centres_m = mesh.points_m[mesh.faces].mean(axis=1)
    n_inner = len(mesh.neighbours)
    total_m2, volume_m3 = np.zeros((mesh.n_cells, 3)), np.zeros(mesh.n_cells)
    np.add.at(total_m2, mesh.owners, areas_m2)
    np.add.at(total_m2, mesh.neighbours, -areas_m2[:n_inner])
    fluxes_m3 = (areas_m2 * centres_m).sum(axis=-1) / 3  # the divergence of the position is 3
    np.add.at(volume_m3, mesh.owners, fluxes_m3)
    np.add.at(volume_m3, mesh.neighbours, -fluxes_m3[:n_inner])
    assert np.allclose(total_m2, 0)
    assert np.allclose(volume_m3, CELL_M**3)


def test_cells_are_numbered_as_the_grid_is_in_memory(room):
    mesh = mesh_of(room)
    centres_m = np.zeros((mesh.n_cells, 3))
    counts = np.zeros(mesh.n_cells)
    for faces, cells in ((slice(None), mesh.owners), (slice(len(mesh.neighbours)), mesh.neighbours)):
        np.add.at(centres_m, cells, mesh.points_m[mesh.faces[faces]].mean(axis=1))
        np.add.at(counts, cells, 1)
    assert np.all(counts == 6)
    assert np.allclose(centres_m / 6, (np.argwhere(room) + 0.5) * CELL_M)


def test_boundaries_follow_each_other_and_lie_where_their_patches_are(room):
    slip = SlipWall(min_m=(0, 0, 2), max_m=(3, 2.5, 2))
    belt = MovingWall(min_m=(0, 0, 0), max_m=(1, 2.5, 0), velocity_m_s=(1, 0, 0))
    mesh = mesh_of(room, slip, belt)
    ends = [b.first_face + b.n_faces for b in mesh.boundaries]
    assert [b.first_face for b in mesh.boundaries] == [len(mesh.neighbours), *ends[:-1]]
    assert ends[-1] == len(mesh.faces)
    assert [(b.name, b.n_faces, b.is_wall) for b in mesh.boundaries[:-1]] == [
        ("inlet_0", 4, False),
        ("outlet_1", 6, False),
        ("slipwall_2", 30, False),
        ("movingwall_3", 10, True),
    ]
    assert mesh.boundaries[-1].name == WALLS
    inlet = mesh.boundaries[0]
    corners_m = mesh.points_m[mesh.faces[inlet.first_face : inlet.first_face + inlet.n_faces]].reshape(-1, 3)
    assert np.array_equal(corners_m.min(axis=0), [0, 0, 0])
    assert np.array_equal(corners_m.max(axis=0), [0, 1, 1])


def test_obstacles_have_walls_and_every_point_is_used(room):
    mesh = mesh_of(room)
    box_faces = 2 * (6 * 5 + 5 * 4 + 6 * 4)
    obstacle_faces = 2 * 2 + 4 * 2 * 2 - 2 * 2  # top and four sides; its floor replaces four faces of the box
    assert mesh.boundaries[-1].n_faces == box_faces - 4 - 6 + obstacle_faces
    assert np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.points_m)))


def test_air_that_no_outlet_can_be_reached_from_is_no_part_of_the_mesh(room):
    room[:, :, 2:] = False
    room[0, 0, 3] = True
    mesh = mesh_of(room)
    assert not mesh.air[0, 0, 3]
    assert mesh.n_cells == room.sum() - 1
