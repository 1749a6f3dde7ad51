"""Every kind of layout: what stands in the room is in it, has a name of its own, and lets the air through."""

import pytest
from pydantic import TypeAdapter

from gslcosim.environment.layouts.layouts import build_furniture, build_layout, find_room_problems, opening_specs
from gslcosim.scenario.model_schema import find_schema_node, list_kinds
from gslcosim.scenario.models.geometry import HomeSpec, Layout, OfficeSpec, OpeningSpec, WindTunnelSpec
from gslcosim.scenario.models.scenario import BoxSpec, WindSpec

KINDS = list_kinds(find_schema_node(("environment", "layout")).annotation)
BY_LOT = ("warehouse_simple", "warehouse_complex", "office", "home", "cluttered_rooms", "plant")
COARSE = WindSpec(cell_m=0.25)


def layout_of(kind, **values):
    return TypeAdapter(Layout).validate_python({"kind": kind, **values})


@pytest.mark.parametrize("seed", range(1, 6))
@pytest.mark.parametrize("kind", KINDS)
def test_what_stands_in_a_room_is_in_it_and_has_a_name_of_its_own(kind, seed):
    layout = layout_of(kind, seed=seed)
    boxes = build_furniture(layout)
    for box in boxes:
        for axis in range(3):
            assert -1e-9 <= box.min_m[axis] < box.max_m[axis] <= layout.size_m[axis] + 1e-9
    assert len({box.name for box in boxes}) == len(boxes)


@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "plant"])
def test_the_air_finds_its_way_from_inlet_to_outlet(kind, seed):
    assert find_room_problems(layout_of(kind, seed=seed), WindSpec(cell_m=0.2)) == []


@pytest.mark.parametrize("kind", BY_LOT)
def test_the_seed_decides_all_that_is_drawn_by_lot(kind):
    first, again, other = (build_furniture(layout_of(kind, seed=seed)) for seed in (1, 1, 2))
    assert first == again
    assert first != other


@pytest.mark.parametrize("kind", ["warehouse_simple", "warehouse_complex"])
def test_a_warehouse_too_small_for_racks_has_none(kind):
    assert [
        box for box in build_furniture(layout_of(kind, size_m=(4.0, 4.0, 2.0))) if box.name.startswith("rack")
    ] == []


def test_an_l_shaped_office_lets_the_air_out_at_the_corridors_end():
    layout = OfficeSpec(outline="l_shape")
    outlet = opening_specs(layout)[1]
    assert (outlet.min_m[1] + outlet.max_m[1]) / 2 == pytest.approx(6.0)
    outside = next(box for box in build_furniture(layout) if box.name == "outside")
    assert outside.max_m == (16.0, 12.0, 3.0)
    assert find_room_problems(layout, WindSpec()) == []


@pytest.mark.parametrize("seed", range(1, 8))
def test_every_room_of_a_flat_can_be_reached(seed):
    layout = HomeSpec(seed=seed, n_rooms=6, has_furniture=False)
    wind = WindSpec(cell_m=0.2)
    from gslcosim.environment.openings import voxelize

    plan = build_layout(layout, wind)
    assert int((plan.occupancy == 1).sum()) == int(voxelize(plan.boxes, plan.grid).sum())


def test_openings_have_the_size_that_was_asked_for_or_that_of_the_face():
    inlet, outlet = opening_specs(layout_of("warehouse_simple", inlet_size_m=(3.0, 2.0), outlet_size_m=(1.0, 4.0)))
    assert (inlet.max_m[1], inlet.max_m[2]) == (3.0, 2.0)
    assert (outlet.min_m, outlet.max_m) == ((15.0, 14.0, 0.0), (15.0, 15.0, 4.0))
    tunnel = WindTunnelSpec()
    assert opening_specs(tunnel)[1] == OpeningSpec(min_m=(8.0, 0.0, 0.0), max_m=(8.0, 2.0, 2.0))


def test_white_yellow_walls_are_whole_and_yellow_above_three_metres():
    plan = build_layout(layout_of("warehouse_empty", walls="white_yellow"), COARSE)
    upper = [box for box in plan.boxes if box.name.endswith("_upper")]
    assert len(upper) == 4
    assert all(box.min_m[2] == 3.0 and box.max_m[2] == 8.0 for box in upper)


def test_an_obstacle_may_not_have_the_name_of_a_rack():
    taken = build_furniture(layout_of("warehouse_simple"))[0].name
    box = BoxSpec(name=taken, min_m=(7.0, 1.0, 0.0), max_m=(8.0, 2.0, 1.0))
    (problem,) = find_room_problems(layout_of("warehouse_simple", obstacles=(box,)), WindSpec())
    assert (problem.where, problem.found) == ("environment.layout.obstacles[0].name", taken)
