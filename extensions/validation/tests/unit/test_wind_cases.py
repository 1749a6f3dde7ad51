"""Cases of wind and buoyancy, on small sets of our own and, where it is there, on the reference data."""

from dataclasses import replace

import numpy as np
import pytest
from reference_data import MEASURED, needs_measured

from gslcosim.environment.generation.wind import no_progress, solve_wind_of_scenario
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.scenario.models.geometry import LayoutSpec
from gslcosim.scenario.models.scenario import EnvironmentSpec, WindSpec
from gslcosim_validation import MeasuredDataError, read_measured
from gslcosim_validation.cases import load_case
from gslcosim_validation.cases.leak_box import solve_leak
from gslcosim_validation.cases.room_wind import solve_room, wind_on_line
from gslcosim_validation.cases.step_wind import StepWind, solve_step
from gslcosim_validation.readers.backward_facing_step import StepFlow, StepProfile
from gslcosim_validation.readers.leak_box import LeakBox, LeakCase, SquareHole
from gslcosim_validation.readers.room_profiles import ProfileLine, RoomProfiles

# `make reality` computes all of each case. Here the room's wind is not yet steady, and one leak stands for all.
SHORTENED = {
    "room-wind": {"MEAN_FROM_S": 30.0, "END_S": 60.0},
    "leak-box": {"QUICK_EVERY": 18, "LATER_S": 600.0},
}
LINE = ProfileLine("x1", np.array([[1.0, 0.5, 0.25], [1.0, 0.5, 0.75]]), np.array([-0.1, 0.2]), {})
ROOM = RoomProfiles(
    size_m=(2.0, 1.0, 1.0),
    inlet_z_m=(0.75, 1.0),
    outlet_z_m=(0.0, 0.25),
    inlet_m_s=1.0,
    inlet_intensity=0.04,
    inlet_length_m=0.025,
    lines=(LINE,),
)


@pytest.mark.parametrize("has_sides", [False, True])
def test_a_room_keeps_its_volume_and_turns_back_at_the_floor(has_sides, monkeypatch):
    monkeypatch.setattr("gslcosim_validation.cases.room_wind.END_S", 30.0)
    monkeypatch.setattr("gslcosim_validation.cases.room_wind.MEAN_FROM_S", 15.0)
    u_m_s, cell_m = solve_room(ROOM, 8, has_sides=has_sides)
    # Mean over the plane of all air that goes along x: what the inlet brings.
    assert u_m_s[4].mean() == pytest.approx(0.25, rel=1e-3)
    assert cell_m == 0.125
    ours = wind_on_line(u_m_s, cell_m, LINE)
    assert ours[1] > ours[0]


def test_wind_on_a_line_is_linear_between_faces():
    u_m_s = np.multiply.outer(np.arange(5.0), np.ones((1, 4))).astype(np.float32)
    line = ProfileLine("x", np.array([[0.6, 0.5, 0.5], [0.5, 0.5, 0.0]]), np.zeros(2), {})
    assert wind_on_line(u_m_s, 0.25, line) == pytest.approx([2.4, 0.0])


def step_flow(*places):
    heights = np.array([0.5, 1.0, 2.0, 4.0])
    profiles = tuple(StepProfile(x, heights, np.ones(4)) for x in places)
    return StepFlow(0.01, 1.0, 5000.0, 10.0, 12.0, 6.0, profiles, np.array([4.0]), np.array([-0.002]))


def test_air_comes_back_to_the_floor_behind_a_step():
    wind = solve_step(step_flow(-2.0, 4.0), 3, "k_epsilon")
    assert 2.0 < wind.reattachment < 8.0
    assert wind.along(StepProfile(4.0, np.array([4.0]), np.array([1.0])))[0] == pytest.approx(0.9, abs=0.1)


def test_wind_that_never_comes_back_has_no_reattachment():
    x, z = np.linspace(-1, 5, 7), np.array([0.25, 0.75])
    assert np.isnan(StepWind(u=-np.ones((7, 2)), x=x, z=z).reattachment)


def test_a_step_without_a_profile_before_it_is_refused():
    with pytest.raises(MeasuredDataError, match="expected a profile before the step"):
        solve_step(step_flow(4.0), 3, "k_epsilon")


def leak_box():
    leak = LeakCase(
        name="ours",
        release_s=60.0,
        release_m3_s=2e-4,
        leak="low",
        position_m=(0.5, 0.5, 0.1),
        vents="one",
        holes=(SquareHole(0.5, 0.25, 0.02),),
        time_s=np.array([0.0, 60.0]),
        volume_percent=np.zeros((2, 2)),
    )
    rake_m = np.array([[0.25, 0.25, 0.1], [0.25, 0.25, 0.4]])
    return LeakBox((1.0, 1.0, 0.5), rake_m, {"low": 1e-3}, 0.166, 294.0, (leak,)), leak


@pytest.mark.slow
def test_a_light_gas_has_layers_with_buoyancy_alone(monkeypatch):
    monkeypatch.setattr("gslcosim_validation.cases.leak_box.LATER_S", 30.0)
    box, leak = leak_box()
    ours = solve_leak(box, leak, 8)
    passive = solve_leak(box, leak, 8, has_buoyancy=False)
    assert ours.at_end[1] > 1.5 * ours.at_end[0] > 0
    assert passive.at_end[1] < 1.2 * passive.at_end[0]
    assert ours.later[1] < ours.at_end[1]


@pytest.mark.slow
def test_a_scenario_solves_the_same_leak(monkeypatch):
    monkeypatch.setattr("gslcosim_validation.cases.leak_box.LATER_S", 1.0)
    box, leak = leak_box()
    ours = solve_leak(box, leak, 8)
    hole = leak.holes[0]
    wind = WindSpec(
        cell_m=0.125,
        end_time_s=leak.release_s,
        buoyancy={
            "density_kg_m3": box.gas_density_kg_m3,
            "releases": [{"position_m": leak.position_m, "flow_m3_s": leak.release_m3_s, "opening_m2": 1e-3}],
            "orifices": [{"centre_m": (0.0, hole.y_m, hole.z_m), "height_m": hole.side_m, "area_m2": hole.side_m**2}],
        },
    )
    environment = EnvironmentSpec(layout=LayoutSpec(size_m=box.size_m))
    room = build_geometry(environment, wind, scenario_dir=None)
    report = solve_wind_of_scenario(room, environment, wind, scenario_dir=None, progress=no_progress).report
    at_rake = 100.0 * np.interp(box.rake_m[:, 2], (np.arange(4) + 0.5) * 0.125, report.scalar[2, 2])
    np.testing.assert_array_equal(at_rake, ours.at_end)
    assert report.summary()["scalar_by_height"] == pytest.approx(report.scalar.mean(axis=(0, 1)), rel=1e-5)


def test_a_leak_that_the_geometry_does_not_have_is_refused():
    box, leak = leak_box()
    with pytest.raises(
        MeasuredDataError, match=r"case ours: expected a leak that geometry.json has \(low\), found high"
    ):
        solve_leak(box, replace(leak, leak="high"), 8)


@needs_measured
@pytest.mark.slow
@pytest.mark.parametrize("name", ["room-wind", "step-wind", "heated-cavity", "leak-box"])
def test_a_case_runs_on_the_reference_data(name, monkeypatch):
    for constant, value in SHORTENED.get(name, {}).items():
        monkeypatch.setattr(f"gslcosim_validation.cases.{name.replace('-', '_')}.{constant}", value)
    result = load_case(name).run(read_measured(MEASURED), "quick")
    assert all(np.isfinite(row.ours.value) for row in result.rows)
    assert all(row.if_missed for row in result.rows if row.is_met is False)
    judged = [row.is_met for row in result.rows if row.goal]
    assert sum(judged) >= {"room-wind": 0, "step-wind": 6, "heated-cavity": 6, "leak-box": 3}[name]
