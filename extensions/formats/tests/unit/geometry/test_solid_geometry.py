"""Rooms from files of geometry: what is air, where the openings are, and which holes are reported."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from gslcosim.base.errors import EnvironmentDataError, ScenarioError
from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.model import Cell, WindFrames, with_wind
from gslcosim.environment.openings import voxelize
from gslcosim.scenario.models.geometry import SimpleWarehouseSpec
from gslcosim.scenario.models.scenario import WindSpec
from gslcosim_formats.export import build_stl
from gslcosim_formats.geometry.solid_geometry import geometry_from_files
from gslcosim_formats.scenario_keys import GeometrySpec
from gslcosim_formats.scene_file import build_mjcf


def box(min_m, max_m):
    return trimesh.creation.box(bounds=[min_m, max_m])


def rectangle(min_m, max_m):
    """Return two triangles across the axis in which both corners are the same."""
    low, high = np.array(min_m, float), np.array(max_m, float)
    axis = int(np.argmin(high - low))
    b, c = (axis + 1) % 3, (axis + 2) % 3
    corners = np.repeat(low[None], 4, axis=0)
    corners[1:3, b], corners[2:4, c] = high[b], high[c]
    return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)


def joined(*meshes):
    return trimesh.util.concatenate(meshes)


def wall_with_hole(axis, at_m, low, high, hole_low, hole_high):
    """Return four rectangles of a wall across an axis around a hole; corners are given along the other axes."""

    def piece(b0, c0, b1, c1):
        corners = [np.zeros(3), np.zeros(3)]
        for corner, (b, c) in zip(corners, ((b0, c0), (b1, c1)), strict=True):
            corner[[axis, (axis + 1) % 3, (axis + 2) % 3]] = at_m, b, c
        return rectangle(*corners)

    (b0, c0), (b1, c1), (h0, k0), (h1, k1) = low, high, hole_low, hole_high
    pieces = ((b0, c0, h0, c1), (h1, c0, b1, c1), (h0, c0, h1, k0), (h0, k1, h1, c1))
    return joined(*(piece(*p) for p in pieces if p[2] > p[0] and p[3] > p[1]))


def write_stl(path: Path, mesh, *, is_text=False):
    content = mesh.export(file_type="stl_ascii" if is_text else "stl")
    path.write_bytes(content.encode() if is_text else content)
    return path


def write_obj(path: Path, meshes):
    lines, n = [], 1
    for name, mesh in meshes.items():
        lines.append(f"o {name}")
        lines += ["v {:.9g} {:.9g} {:.9g}".format(*vertex) for vertex in mesh.vertices]
        lines += ["f {} {} {}".format(*face) for face in mesh.faces + n]
        n += len(mesh.vertices)
    path.write_text("\n".join([*lines, ""]))
    return path


def write_glb(path: Path, meshes):
    """Write named meshes as nodes of a glTF file, y upwards."""
    scene = trimesh.Scene()
    for name, mesh in meshes.items():
        turned = mesh.copy()
        turned.vertices = np.stack((mesh.vertices[:, 0], mesh.vertices[:, 2], -mesh.vertices[:, 1]), axis=1)
        scene.add_geometry(turned, node_name=name, geom_name=f"{name}_mesh")
    path.write_bytes(scene.export(file_type="glb"))
    return path


def box_opening(name, kind, min_m, max_m, **more):
    return {"name": name, "kind": kind, "box": {"min_m": min_m, "max_m": max_m}, **more}


def build(*files, cell_m=0.2, solver="built_in", **more):
    spec = GeometrySpec.model_validate({"files": [path.name for path in files], **more})
    wind = WindSpec(cell_m=cell_m, solver=solver)
    return geometry_from_files(spec, wind, base_dir=files[0].parent)


INLET = box_opening("inlet", "inlet", (0, 0, 0), (0, 1, 1))
OUTLET = box_opening("outlet", "outlet", (4, 2, 0), (4, 3, 1))
BOTH = [INLET, OUTLET]


def refusal(*files, error=ScenarioError, **more):
    with pytest.raises(error) as raised:
        build(*files, **more)
    return str(raised.value)


def air(room):
    return room.occupancy != Cell.SOLID


@pytest.fixture
def shell(tmp_path):
    """A closed room of 4 x 3 x 2 m, its inner surface only."""
    return write_stl(tmp_path / "room.stl", box((0, 0, 0), (4, 3, 2)))


def test_walls_on_the_planes_of_the_grid_do_not_thicken(tmp_path):
    file = write_stl(tmp_path / "hall.stl", box((0, 0, 0), (15, 15, 8)))
    openings = [
        box_opening("inlet", "inlet", (0, 0, 0), (0, 1.5, 2.4)),
        box_opening("outlet", "outlet", (15, 13.5, 0), (15, 15, 2.4)),
    ]
    room = build(file, openings=openings)
    assert room.grid.shape == (75, 75, 40)
    assert room.grid.origin_m == (0.0, 0.0, 0.0)
    assert air(room).all()
    assert {box.kind for box in room.boxes} == {"wall", "floor", "ceiling"}


@pytest.mark.parametrize("is_text", [False, True])
def test_a_file_in_millimetres_lies_where_it_is_placed(tmp_path, is_text):
    file = write_stl(tmp_path / "Room 1.stl", box((0, 0, 0), (4000, 3000, 2000)), is_text=is_text)
    moved = [
        box_opening("inlet", "inlet", (-7, 1, 0.5), (-7, 2, 1.5)),
        box_opening("outlet", "outlet", (-3, 3, 0.5), (-3, 4, 1.5)),
    ]
    room = build(file, scale=0.001, translate_m=(-7, 1, 0.5), openings=moved)
    assert room.name == "room_1"
    assert room.grid.origin_m == (-7.0, 1.0, 0.5)
    assert room.grid.max_m == pytest.approx((-3.0, 4.0, 2.5))
    assert air(room).all()


def test_openings_are_whole_cells_on_the_sides_of_the_grid(shell):
    room = build(shell, openings=[box_opening("window", "inlet", (-0.1, 0.5, 0.7), (0.1, 1.3, 1.5)), OUTLET])
    window, outlet = room.openings
    assert (window.kind, window.min_m, window.max_m) == ("inlet", (0.0, 0.4, 0.6), (0.0, 1.4, 1.6))
    assert window.velocity_m_s == (1.0, 0.0, 0.0)
    assert (outlet.kind, outlet.min_m, outlet.max_m) == ("outlet", (4.0, 2.0, 0.0), (4.0, 3.0, 1.0))
    is_outlet = np.zeros(room.grid.shape, bool)
    is_outlet[-1, 10:, :5] = True
    assert ((room.occupancy == Cell.OUTLET) == is_outlet).all()


@pytest.mark.parametrize(
    ("min_m", "max_m", "velocity_m_s"),
    [
        ((4, 0, 0), (4, 1, 1), (-1, 0, 0)),
        ((0, 0, 0), (1, 0, 1), (0, 1, 0)),
        ((0, 3, 0), (1, 3, 1), (0, -1, 0)),
        ((0, 0, 0), (1, 1, 0), (0, 0, 1)),
        ((0, 0, 2), (1, 1, 2), (0, 0, -1)),
    ],
)
def test_an_inlet_blows_straight_inwards(shell, min_m, max_m, velocity_m_s):
    room = build(shell, openings=[box_opening("inlet", "inlet", min_m, max_m), OUTLET])
    assert room.openings[0].velocity_m_s == velocity_m_s


def test_an_inlet_has_the_velocity_it_says(shell):
    assert build(shell, openings=[INLET | {"velocity_m_s": (0.5, 0.2, 0)}, OUTLET]).openings[0].velocity_m_s == (
        0.5,
        0.2,
        0.0,
    )
    text = refusal(shell, openings=[INLET | {"velocity_m_s": (-0.5, 0, 0)}, OUTLET])
    assert "openings[0]: expected at inlet, [0, 0, 0] to [0, 1, 1] m, a velocity that enters through x_min" in text


def test_walls_with_thickness_and_holes_keep_their_air_inside(tmp_path):
    """Two walls of 0.3 m with a hole each; the cells begin at the inner surface, the rest of the tunnels is cut off."""
    slabs = [
        box(low, high)
        for low, high in (
            ((-0.3, -0.3, -0.3), (4.3, 3.3, 0)), ((-0.3, -0.3, 2), (4.3, 3.3, 2.3)),
            ((-0.3, -0.3, 0), (4.3, 0, 2)), ((-0.3, 3, 0), (4.3, 3.3, 2)),
            *(
                ((x, *low), (x + 0.3, *high))
                for x in (-0.3, 4)
                for low, high in (
                    ((0, 0), (1, 2)), ((2, 0), (3, 2)), ((1, 0), (2, 0.4)), ((1, 1.4), (2, 2))
                )
            ),
        )
    ]  # fmt: skip
    file = write_stl(tmp_path / "house.stl", joined(*slabs))
    openings = [
        box_opening("door", "inlet", (-0.4, 1, 0.4), (0.1, 2, 1.4)),
        box_opening("window", "outlet", (4, 1, 0.4), (4.3, 2, 1.4)),
    ]
    room = build(file, openings=openings)
    assert (room.grid.origin_m, room.grid.shape) == ((0.0, 0.0, 0.0), (20, 15, 10))
    assert air(room).all()
    assert [(o.min_m, o.max_m) for o in room.openings] == [
        ((0.0, 1.0, 0.4), (0.0, 2.0, 1.4)),
        ((4.0, 1.0, 0.4), (4.0, 2.0, 1.4)),
    ]


def test_obstacles_alone_stand_in_the_bounds(tmp_path):
    file = write_stl(tmp_path / "blocks.stl", joined(box((1, 1, -0.1), (2, 2, 1)), box((2.5, 0.5, 0), (3, 1, 0.5))))
    bounds = {"min_m": (0, 0, 0), "max_m": (4, 3, 2)}
    openings = [box_opening("wind", "inlet", (0, 0, 0), (0, 3, 2)), box_opening("lee", "open", (4, 0, 0), (4, 3, 2))]
    room = build(file, bounds_m=bounds, openings=openings)
    expected = np.zeros((20, 15, 10), bool)
    expected[5:10, 5:10, :5] = True
    expected[12:15, 2:5, :2] = True
    assert (air(room) == ~expected).all()
    assert [o.kind for o in room.openings] == ["inlet", "open"]
    inside = [box for box in room.boxes if box.kind == "obstacle"]
    assert (voxelize(inside, room.grid) == expected).all()


def test_obstacles_alone_without_bounds_are_reported_how_to_get_some(tmp_path):
    file = write_stl(tmp_path / "block.stl", box((1, 1, 0), (2, 2, 1)))
    openings = [box_opening("a", "inlet", (0, 0, 0), (0, 3, 2)), box_opening("b", "outlet", (4, 0, 0), (4, 3, 2))]
    assert "cut the air off with bounds_m: the geometry's box is {min_m: [0, 0, 0], max_m: [4, 3, 2]}" in refusal(
        file, openings=openings
    )


def named_room():
    """Walls, and the openings in them as surfaces of their own."""
    return {
        "walls": joined(
            wall_with_hole(0, 0, (0, 0), (3, 2), (0, 0), (1, 1)),
            wall_with_hole(0, 4, (0, 0), (3, 2), (2, 0), (3, 1)),
            *(
                rectangle(low, high)
                for low, high in (
                    ((0, 0, 0), (4, 0, 2)), ((0, 3, 0), (4, 3, 2)), ((0, 0, 0), (4, 3, 0)), ((0, 0, 2), (4, 3, 2))
                )
            ),
        ),
        "Inlet.west": rectangle((0, 0, 0), (0, 1, 1)),
        "outlet": rectangle((4, 2, 0), (4, 3, 1)),
        "crate": box((1, 1, 0), (1.6, 1.6, 0.6)),
    }  # fmt: skip


@pytest.mark.parametrize(("write", "name"), [(write_obj, "room.obj"), (write_glb, "room.glb")])
def test_surfaces_called_inlet_and_outlet_are_openings(tmp_path, write, name):
    room = build(write(tmp_path / name, named_room()))
    assert air(room).sum() == 20 * 15 * 10 - 27
    assert {(o.name, o.kind, o.min_m, o.max_m) for o in room.openings} == {
        ("inlet_west", "inlet", (0.0, 0.0, 0.0), (0.0, 1.0, 1.0)),
        ("outlet", "outlet", (4.0, 2.0, 0.0), (4.0, 3.0, 1.0)),
    }
    assert sorted(mesh.name for mesh in room.meshes) == ["crate", "walls"]


def test_a_surface_can_be_named_in_the_scenario(tmp_path):
    meshes = named_room()
    meshes["grating"] = meshes.pop("outlet")
    file = write_glb(tmp_path / "room.glb", meshes)
    room = build(file, openings=[{"name": "exhaust", "kind": "outlet", "surface": "grating_mesh"}])
    assert sorted(o.name for o in room.openings) == ["exhaust", "inlet_west"]
    text = refusal(file, openings=[{"name": "exhaust", "kind": "outlet", "surface": "granting"}])
    assert "openings[0].surface: expected the name of a part of the files: Inlet.west" in text
    assert "was granting. Name a mesh" in text


def test_a_recessed_opening_gets_a_duct_to_the_side_of_the_grid(tmp_path):
    """An L-shaped room whose outlet lies in the inner corner."""
    corner = box((2, 2, -0.5), (5, 4, 2.5))
    room = build(
        write_stl(tmp_path / "l.stl", joined(box((0, 0, 0), (4, 3, 2)), corner)),
        openings=[INLET, box_opening("outlet", "outlet", (2, 2.2, 0), (2, 2.8, 1))],
    )
    assert (room.openings[1].min_m, room.openings[1].max_m) == ((4.0, 2.2, 0.0), (4.0, 2.8, 1.0))
    expected = np.ones((20, 15, 10), bool)
    expected[10:, 10:] = False
    expected[10:, 11:14, :5] = True
    assert (air(room) == expected).all()
    assert any("outlet lies 2 m inside the air's box; a duct leads straight out" in text for text in room.notices)


@pytest.mark.parametrize(
    "change",
    [
        lambda mesh: mesh.invert(),
        lambda mesh: mesh.update_faces(np.repeat(np.arange(len(mesh.faces)), 2)),
        lambda mesh: setattr(mesh, "faces", np.vstack((mesh.faces, [(0, 0, 1), (2, 2, 2)]))),
        lambda mesh: setattr(mesh, "faces", mesh.faces[::-1][:, [1, 2, 0]]),
    ],
    ids=["flipped", "doubled", "degenerate", "shuffled"],
)
def test_the_room_is_the_same_with_faces_that_are(tmp_path, change):
    mesh = joined(box((0, 0, 0), (4, 3, 2)), trimesh.creation.icosphere(radius=0.7).apply_translation((2, 1.5, 1)))
    before = build(write_stl(tmp_path / "a.stl", mesh), openings=BOTH)
    change(mesh)
    after = build(write_stl(tmp_path / "b.stl", mesh), openings=BOTH)
    assert (after.occupancy == before.occupancy).all()
    assert 0 < (~air(before)).sum() < 400


def test_a_round_body_has_its_volume(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.8).apply_translation((2, 1.5, 1))
    file = write_stl(tmp_path / "ball.stl", joined(box((0, 0, 0), (4, 3, 2)), ball))
    room = build(file, openings=BOTH, cell_m=0.1)
    assert (~air(room)).sum() * 0.1**3 == pytest.approx(ball.volume, rel=0.05)


def test_thin_plates_and_posts_take_the_cells_that_hold_their_middle(tmp_path, shell):
    things = joined(box((1.05, 1, 0.3), (2.2, 2, 0.34)), box((3.02, 1.02, 0), (3.06, 1.06, 2)))
    room = build(shell, write_stl(tmp_path / "things.stl", things), openings=BOTH)
    expected = np.zeros((20, 15, 10), bool)
    expected[5:11, 5:10, 1] = True
    expected[15, 5, :] = True
    assert (~air(room) == expected).all()


def test_a_sheet_without_thickness_keeps_air_apart(tmp_path, shell):
    """A partition that ends a metre before the wall: one cell thick, and the air goes round it."""
    for x_m, layer in ((2.0, 10), (1.93, 9), (2.1, 10)):
        sheet = write_stl(tmp_path / "sheet.stl", rectangle((x_m, 0, 0), (x_m, 2, 2)))
        solid = ~air(build(shell, sheet, openings=BOTH))
        expected = np.zeros((20, 15, 10), bool)
        expected[layer, :10] = True
        assert (solid == expected).all(), x_m


def hall_with_hole(path, hole_low, hole_high, cell_m=0.2):
    """Write a room of 4 x 3 x 2 m whose ceiling has a hole; corners along x and y."""
    ceiling = wall_with_hole(2, 2.0, (0, 0), (4, 3), hole_low, hole_high)
    shell = box((0, 0, 0), (4, 3, 2))
    shell.update_faces(~(shell.triangles[:, :, 2] == 2.0).all(axis=1))
    return write_stl(path, joined(shell, ceiling))


def test_a_hole_is_reported_with_its_place_and_size(tmp_path):
    text = refusal(hall_with_hole(tmp_path / "roof.stl", (1.0, 1.2), (1.8, 1.6)), openings=BOTH)
    assert text.startswith("environment.geometry: expected surfaces and openings that close the air in, was a hole of ")
    assert "about 0.8 x 0.4 m near [1.4, 1.4, " in text
    assert "beside roof.stl" in text
    assert "Close the mesh there, declare an opening there" in text


def test_a_declared_opening_closes_a_hole(tmp_path):
    file = hall_with_hole(tmp_path / "roof.stl", (1.0, 1.2), (1.8, 1.6))
    hatch = box_opening("hatch", "outlet", (1, 1.2, 1.9), (1.8, 1.6, 2.1))
    room = build(file, openings=[INLET, hatch])
    assert (room.openings[1].min_m, room.openings[1].max_m) == ((1.0, 1.2, 2.0), (1.8, 1.6, 2.0))
    assert air(room).all()


def test_without_an_opening_of_each_kind_the_wind_cannot_be_solved(shell):
    text = refusal(shell, openings=[INLET])
    assert (
        "environment.geometry.openings: expected at least one outlet, since wind.solver is built_in, was none" in text
    )
    assert "at least one inlet" in refusal(shell, openings=[OUTLET])
    assert build(shell, solver="uniform").openings == ()


@pytest.mark.parametrize("solver", ["uniform", "stored", {"file": "wind.csv"}])
@pytest.mark.parametrize("kinds", [(), ("inlet",), ("outlet",), ("outlet", "outlet")])
def test_a_wind_that_is_not_solved_needs_no_openings(shell, solver, kinds):
    openings = [box_opening(f"{kind}_{i}", kind, (4 * i, 1, 0), (4 * i, 2, 1)) for i, kind in enumerate(kinds)]
    assert [each.kind for each in build(shell, solver=solver, openings=openings).openings] == [*kinds]


@pytest.mark.parametrize(
    ("surfaces", "n_faces"),
    [
        # Four sides; around a corner; floor and roof; two windows in one wall.
        ([rectangle((0, 0, 0), (0, 3, 1)), rectangle((4, 0, 0), (4, 3, 1)),
          rectangle((0, 0, 0), (4, 0, 1)), rectangle((0, 3, 0), (4, 3, 1))], 4),
        ([rectangle((0, 0, 0), (0, 2, 1)), rectangle((0, 0, 0), (2, 0, 1))], 2),
        ([rectangle((1, 1, 0), (2, 2, 0)), rectangle((1, 1, 2), (2, 2, 2))], 2),
        ([rectangle((0, 0.4, 0.4), (0, 1, 1)), rectangle((0, 2, 0.4), (0, 2.6, 1))], 2),
        # A grille of slats, the two sides of a pane, and a body in the wall are one.
        ([rectangle((0, 1, z), (0, 2, z + 0.1)) for z in (0.4, 0.6, 0.8)], 1),
        ([rectangle((0, 1, 0.4), (0, 2, 1)), rectangle((-0.1, 1, 0.4), (-0.1, 2, 1))], 1),
        ([box((-0.2, 1, 0.4), (0, 1.6, 1))], 1),
    ],
)  # fmt: skip
def test_a_surface_in_several_walls_is_an_opening_in_each(tmp_path, surfaces, n_faces):
    path = write_obj(tmp_path / "room.obj", {"hull": box((0, 0, 0), (4, 3, 2)), "outlet": joined(*surfaces)})
    room = build(path, solver="uniform", free_point_m=(2, 1.5, 1.5))
    assert [opening.kind for opening in room.openings] == ["outlet"] * n_faces
    assert len({opening.name for opening in room.openings}) == n_faces
    assert (room.occupancy == Cell.OUTLET).any()


def test_an_opening_inside_a_wall_or_the_room_is_named(shell, tmp_path):
    far = box_opening("outlet", "outlet", (6, 2, 0), (6, 3, 1))
    crate = write_stl(tmp_path / "crate.stl", box((3, 1, -1), (5, 4, 3)))
    text = refusal(shell, crate, openings=[INLET, box_opening("outlet", "outlet", (4, 2, 0), (4, 3, 1))])
    assert "openings[1]: expected at outlet, [4, 2, 0] to [4, 3, 1] m, air beside it, was none" in text
    assert "openings[1]: expected at outlet" in refusal(shell, openings=[INLET, far], free_point_m=(2, 1.5, 1))
    middle = box_opening("outlet", "outlet", (2, 1, 0.5), (2, 2, 1.5))
    assert "air on one side of it, was air on both: it lies within the room" in refusal(shell, openings=[INLET, middle])


def test_openings_that_overlap_are_named(shell):
    again = box_opening("again", "outlet", (0, 0.4, 0), (0, 2, 1))
    assert "was inlet and again that overlap" in refusal(shell, openings=[INLET, OUTLET, again])


def test_a_free_point_chooses_the_air(tmp_path):
    rooms = joined(box((0, 0, 0), (2, 3, 2)), box((2, 0, 0), (4, 3, 2)))
    file = write_stl(tmp_path / "rooms.stl", rooms)
    left, right = (build(file, solver="uniform", free_point_m=(x, 1.5, 1)) for x in (1, 3))
    assert (left.grid.origin_m, left.grid.shape) == ((0.0, 0.0, 0.0), (10, 15, 10))
    assert (right.grid.origin_m, right.grid.shape) == ((2.0, 0.0, 0.0), (10, 15, 10))


def test_a_free_point_in_a_wall_is_refused(shell):
    for point_m, found in (((0, 1.5, 1.05), "in a cell that a surface passes"), ((99, 0, 0), "outside")):
        text = refusal(shell, openings=BOTH, free_point_m=point_m, translate_m=(0.05, 0.05, 0.05))
        assert "free_point_m: expected a point in the air" in text
        assert found in text


def test_too_many_cells_are_refused_with_a_remedy(shell):
    text = refusal(shell, openings=BOTH, scale=1000)
    assert "wind.cell_m: expected cells that divide the geometry into at most 2e+08" in text
    assert "files in millimetres need scale: 0.001" in text


def test_a_room_smaller_than_a_cell_is_refused(shell):
    text = refusal(shell, scale=0.001, solver="uniform")
    assert "free_point_m: expected cells of 0.2 m that no surface touches" in text
    assert "check scale" in text


def test_bounds_are_whole_cells(shell):
    text = refusal(shell, openings=BOTH, bounds_m={"min_m": (0, 0, 0), "max_m": (4, 3.05, 2)})
    assert "bounds_m.max_m[1]: expected a whole number of the 0.2 m cells of wind.cell_m above 0 m, was 3.05 m" in text


def test_all_files_that_cannot_be_read_are_named(tmp_path):
    text = refusal(tmp_path / "a.stl", tmp_path / "b.step", error=EnvironmentDataError)
    assert "environment.geometry.files[0]: a.stl: expected a file of geometry, was no such file" in text
    assert "environment.geometry.files[1]: b.step: expected a file of .stl, .obj, .glb, .gltf, .xml, was .step" in text


def generated(layout):
    room = build_layout(layout, WindSpec(cell_m=0.2))
    still = np.zeros((1, *room.grid.shape, 3), np.float32)
    environment = with_wind(room, WindFrames(velocity_m_s=still))
    openings = [box_opening(o.name, o.kind, o.min_m, o.max_m) for o in room.openings]
    return environment, openings


def meshes_of(environment):
    return {element.name: box(element.min_m, element.max_m) for element in environment.boxes}


def write_environment_stl(path, environment):
    path.write_bytes(build_stl(environment))
    return path


def write_environment_mjcf(path, environment):
    path.write_text(build_mjcf(environment))
    return path


WRITERS = {
    "stl": write_environment_stl,
    "xml": write_environment_mjcf,
    "obj": lambda path, environment: write_obj(path, meshes_of(environment)),
    "glb": lambda path, environment: write_glb(path, meshes_of(environment)),
}


@pytest.mark.slow
@pytest.mark.parametrize("ending", WRITERS)
def test_a_generated_warehouse_comes_back_with_the_same_cells(tmp_path, ending):
    environment, openings = generated(SimpleWarehouseSpec())
    room = build(WRITERS[ending](tmp_path / f"warehouse.{ending}", environment), openings=openings)
    assert room.grid == environment.grid
    assert (room.occupancy == environment.occupancy).all()
    assert room.openings == environment.openings
