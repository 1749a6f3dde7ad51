"""Openings beside the layout's own, and lamps: where they come to lie, and what is refused."""

import pytest

from gslcosim.environment.generation.wind import build_patches
from gslcosim.environment.layouts.layouts import build_layout, find_room_problems
from gslcosim.environment.model import Cell
from gslcosim.scenario.models.geometry import FurtherOpeningSpec, LayoutSpec, PlantSpec
from gslcosim.scenario.models.scenario import WindSpec

WIND = WindSpec(cell_m=0.5)


def layout(*openings, **fields):
    specs = tuple(FurtherOpeningSpec.model_validate(each) for each in openings)
    return LayoutSpec(size_m=(6.0, 5.0, 3.0), openings=specs, **fields)


DOOR = {"name": "door", "kind": "outlet", "min_m": (2.0, 5.0, 0.0), "max_m": (3.0, 5.0, 2.0)}
VENT = {"name": "vent", "kind": "inlet", "min_m": (4.0, 2.0, 3.0), "max_m": (5.0, 3.0, 3.0)}


def test_further_openings_are_there_with_their_own_wind_or_the_scenario_s():
    fan = {**VENT, "name": "fan", "velocity_m_s": (0.0, 0.0, 0.4), "min_m": (1.0, 2.0, 3.0), "max_m": (2.0, 3.0, 3.0)}
    openings = {o.name: o for o in build_layout(layout(DOOR, VENT, fan), WIND).openings}
    assert list(openings) == ["inlet", "outlet", "door", "vent", "fan"]
    assert openings["vent"].velocity_m_s == WIND.inlet_velocity_m_s
    assert openings["fan"].velocity_m_s == (0.0, 0.0, 0.4)
    assert openings["door"].velocity_m_s == (0.0, 0.0, 0.0)


def test_cells_at_an_outlet_in_another_wall_end_filaments_and_those_at_an_inlet_do_not():
    room = build_layout(layout(DOOR, VENT), WIND)
    assert (room.occupancy[4:6, -1, :4] == Cell.OUTLET).all()
    assert (room.occupancy[8:10, 4:6, -1] == Cell.FREE).all()


def test_solvers_get_a_patch_for_each_opening():
    kinds = [
        type(patch).__name__
        for patch in build_patches(build_layout(layout(DOOR, {**VENT, "kind": "open"}), WIND), WIND)
    ]
    assert kinds == ["Inlet", "Outlet", "Outlet", "Open"]


@pytest.mark.parametrize(
    ("opening", "path", "found"),
    [
        ({**DOOR, "name": "inlet"}, "openings[0].name", "inlet"),
        ({**DOOR, "min_m": (2.0, 4.0, 0.0), "max_m": (3.0, 4.0, 2.0)}, "openings[0]", "[2, 4, 0] to [3, 4, 2] m"),
        ({**DOOR, "min_m": (6.0, 4.0, 0.0), "max_m": (6.0, 5.0, 2.0)}, "openings[0]", "overlap"),
    ],
)
def test_openings_that_cannot_be_are_refused(opening, path, found):
    (problem,) = find_room_problems(layout(opening), WIND)
    assert problem.where == f"environment.layout.{path}"
    assert found in problem.found


def test_only_inlets_have_a_velocity():
    with pytest.raises(ValueError, match="no velocity for an outlet"):
        FurtherOpeningSpec.model_validate({**DOOR, "velocity_m_s": (1.0, 0.0, 0.0)})


def test_lamps_hang_in_rows_below_the_ceiling():
    room = build_layout(layout(lights=(2, 1)), WIND)
    assert [(light.name, light.position_m) for light in room.lights] == [
        ("light_0_0", (1.5, 2.5, 2.94)),
        ("light_1_0", (4.5, 2.5, 2.94)),
    ]


def test_outdoors_there_is_daylight_only():
    assert build_layout(PlantSpec(), WIND).lights == ()
    assert len(build_layout(LayoutSpec(), WIND).lights) == 4
