"""Surfaces: what hangs together, what is closed, and what is left out."""

import numpy as np
import trimesh

from gslcosim_formats.geometry.cell_kernels import join_inplace
from gslcosim_formats.geometry.mesh_formats import Part
from gslcosim_formats.geometry.surfaces import build_surfaces

NO_OPENINGS = np.empty((0, 3, 3))


def part(*meshes):
    mesh = trimesh.util.concatenate(meshes)
    # Every triangle with corners of its own, as STL has them.
    vertices_m, faces = mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3)
    return Part(name="part", names=frozenset(), vertices_m=vertices_m, faces=faces)


def box(low, high):
    return trimesh.creation.box(bounds=[low, high])


def test_boxes_that_touch_are_bodies_of_their_own():
    touching = part(box((0, 0, 0), (1, 1, 1)), box((1, 0, 0.5), (2, 1, 1)), box((5, 0, 0), (6, 1, 1)))
    surfaces = build_surfaces([touching], NO_OPENINGS)
    assert np.bincount(surfaces.body).tolist()[:3] == [12, 12, 12]
    assert surfaces.closed[:3].all()


def test_a_box_without_a_side_is_not_closed():
    mesh = box((0, 0, 0), (1, 1, 1))
    mesh.update_faces(np.arange(12) > 1)
    surfaces = build_surfaces([part(mesh)], NO_OPENINGS)
    assert not surfaces.closed[surfaces.body].any()


def test_doubles_and_triangles_without_area_are_left_out():
    whole = part(box((0, 0, 0), (1, 1, 1)))
    line = np.array([(0, 0, 0), (0.5, 0, 0), (1, 0, 0)])
    faces = np.vstack((whole.faces, whole.faces[:5][:, ::-1], [36, 37, 38]))
    doubled = Part(name="part", names=frozenset(), vertices_m=np.vstack((whole.vertices_m, line)), faces=faces)
    surfaces = build_surfaces([doubled], NO_OPENINGS)
    assert (surfaces.corners_m == whole.vertices_m[whole.faces]).all()
    assert surfaces.closed[surfaces.body].all()


def test_places_far_apart_are_distinguished_too():
    """Kilometres in steps of a hundredth of a millimetre along three axes are more than one number holds."""
    far = part(box((0, 0, 0), (1, 1, 1)), box((9000, 9000, 9000), (9001, 9001, 9001)))
    doubled = Part(name="part", names=frozenset(), vertices_m=far.vertices_m, faces=np.vstack((far.faces, far.faces)))
    surfaces = build_surfaces([doubled], NO_OPENINGS)
    assert np.bincount(surfaces.body).tolist() == [12, 12]
    assert surfaces.closed[surfaces.body].all()


def test_openings_are_no_part():
    surfaces = build_surfaces([part(box((0, 0, 0), (1, 1, 1)))], np.array([[(0, 0, 0), (1, 0, 0), (0, 1, 0)]], float))
    assert surfaces.is_opening(np.arange(13)).tolist() == [False] * 12 + [True]


def test_joined_things_have_one_root():
    roots = np.arange(7)
    join_inplace(roots, np.array([5, 2, 3, 6]), np.array([3, 4, 2, 6]))
    assert roots.tolist() == [0, 1, 2, 2, 2, 2, 6]
