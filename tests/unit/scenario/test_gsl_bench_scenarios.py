"""The six environments of GSL-Bench as bundled scenarios, with the data of Tables I and II."""

import pytest

from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.positions import find_position_problems
from gslcosim.scenario import load_scenario

KINDS = {1: "empty", 2: "empty", 3: "simple", 4: "simple", 5: "complex", 6: "complex"}


@pytest.mark.parametrize("number", KINDS)
def test_an_environment_of_the_thesis_is_bundled_with_its_boundary_data(number):
    scenario = load_scenario(f"gsl_bench_{number}").scenario
    layout = scenario.environment.layout
    assert layout is not None
    assert (layout.kind, layout.size_m) == (f"warehouse_{KINDS[number]}", (15.0, 15.0, 8.0))
    inlet, outlet = build_layout(layout, scenario.wind).openings
    assert (inlet.velocity_m_s, inlet.min_m, inlet.max_m) == ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 1.6, 2.4))
    assert (outlet.min_m, outlet.max_m) == ((15.0, 13.4, 0.0), (15.0, 15.0, 2.4))
    assert (scenario.wind.cell_m, scenario.wind.end_time_s, scenario.gas.gas) == (0.2, 5.0, "ethanol")
    x_m, y_m, z_m = scenario.gas.sources[0].position_m
    assert (y_m, z_m) == ((1.0, 2.0) if number % 2 else (10.0, 2.0))
    assert x_m == (5.0 if number % 2 else 1.0 if number == 2 else 1.2)
    assert find_position_problems(scenario) == []
