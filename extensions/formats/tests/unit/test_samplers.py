"""Gas and wind of one instant, from folders and from rooms."""

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim.contract.participant import Episode
from gslcosim_formats.field_samplers import (
    Instant,
    ScenarioFieldSampler,
    ViewOptions,
    build_lattice,
)
from gslcosim_services.fields.core import FieldsCore
from gslcosim_services.fields.mixing_ratio import Walls, mixing_ratio_ppm_at

THROUGH_WALLS = ViewOptions(has_line_of_sight=False)


@pytest.fixture
def scenario(make_scenario):
    return make_scenario(gas={"sources": [{"position_m": (5.0, 1.0, 2.0)}], "warm_up_s": 20.0})


def test_the_lattice_is_that_of_the_world_whatever_the_walls_thickness():
    """GSL-Bench's rooms reach 0.2 m into their walls; its published grids do not."""
    lattice = build_lattice((-0.2, -0.2, 0.0), (15.2, 15.2, 8.0), 0.25)
    assert (lattice.first_m, lattice.shape) == ((0.125, 0.125, 0.125), (60, 60, 32))
    assert build_lattice((0.0, 0.0, 0.0), (15.0, 10.0, 6.0), 0.25).shape == (60, 40, 24)
    np.testing.assert_allclose(lattice.points_m()[[0, 1, 32, -1]], [
        (0.125, 0.125, 0.125), (0.125, 0.125, 0.375), (0.125, 0.375, 0.125), (14.875, 14.875, 7.875),
    ])  # fmt: skip


def test_a_lattice_wider_than_the_room_is_refused():
    with pytest.raises(UsageError, match="expected a spacing below the sides"):
        build_lattice((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 2.0)


def test_a_room_is_sampled_as_its_run_is(scenario, make_room):
    """The same instant, asked of the room and of the run's own fields."""
    room = make_room(wind_m_s=((0.3, 0.1, 0.0),))
    core = FieldsCore(scenario, room)
    core.reset(Episode(seed=scenario.seed))
    core.gas.advance(30)
    points = np.array([(5.5, 1.2, 2.0), (6.0, 1.4, 2.1)])
    expected = mixing_ratio_ppm_at(points, core.gas.filaments, walls=Walls.of(room))[:, 0]
    assert expected.min() > 0.0
    fields = ScenarioFieldSampler(room, scenario)
    for instant in (Instant(time_s=3.0), Instant(time_s=3.05), Instant(frame=30)):
        np.testing.assert_allclose(fields.gas_ppm(points, instant, ViewOptions()), expected, rtol=1e-12)
    np.testing.assert_allclose(fields.wind_m_s(points, Instant(frame=30)), [(0.3, 0.1, 0.0)] * 2, rtol=1e-6)


def test_a_rooms_grid_is_the_values_at_its_points(scenario, make_room):
    fields = ScenarioFieldSampler(make_room(wind_m_s=((0.3, 0.1, 0.0),)), scenario)
    lattice = build_lattice((4.0, 0.0, 1.0), (7.0, 2.0, 3.0), 0.5)
    for view in (ViewOptions(), THROUGH_WALLS, ViewOptions(has_line_of_sight=False, cutoff_sigma=2.0)):
        volume = fields.gas_ppm_on(lattice, Instant(time_s=0.0), view)
        points = fields.gas_ppm(lattice.points_m(), Instant(time_s=0.0), view)
        np.testing.assert_allclose(volume.reshape(-1), points, rtol=1e-9)
    assert volume.max() > 0.0


def test_an_environment_alone_has_wind_and_no_gas(make_room):
    fields = ScenarioFieldSampler(make_room(wind_m_s=((0.1, 0.0, 0.0), (0.2, 0.0, 0.0))))
    points = np.array([(5.0, 1.0, 2.0)])
    winds = [fields.wind_m_s(points, instant)[0, 0] for instant in (Instant(time_s=1.5), Instant(frame=0))]
    assert winds == pytest.approx([0.2, 0.1])
    with pytest.raises(UsageError, match="one of the wind's frames, 0 to 1, was 2"):
        fields.wind_m_s(points, Instant(frame=2))
    with pytest.raises(UsageError, match="Add --scenario SCENARIO"):
        fields.gas_ppm(points, Instant(time_s=0.0), ViewOptions())


def test_another_gas_can_be_asked_for(scenario, make_room):
    sources = (*scenario.gas.sources, scenario.gas.sources[0].model_copy(update={"gas": "methane", "ppm": 50.0}))
    both = scenario.model_copy(update={"gas": scenario.gas.model_copy(update={"sources": sources})})
    points = np.array([(5.0, 1.0, 2.0)])
    ethanol, methane = (
        ScenarioFieldSampler(make_room(), both, gas=gas).gas_ppm(points, Instant(time_s=0.0), ViewOptions())[0]
        for gas in ("ethanol", "methane")
    )
    assert methane > 2 * ethanol > 0.0
    with pytest.raises(UsageError, match="--gas: expected one of ethanol, methane, was 'xenon'"):
        ScenarioFieldSampler(make_room(), both, gas="xenon").gas_ppm(points, Instant(time_s=0.0), ViewOptions())
