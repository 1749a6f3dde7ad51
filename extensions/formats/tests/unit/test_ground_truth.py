"""Ground truth for scoring."""

import numpy as np
import pytest

from gslcosim.contract.participant import Episode
from gslcosim_formats.field_samplers import compute_ground_truth, ground_truth_from_field, list_true_sources
from gslcosim_services.fields.core import FieldsCore
from gslcosim_services.fields.gas_setup import mean_release_m3_s


@pytest.fixture
def scenario(make_scenario):
    scheduled = {"kind": "scheduled", "schedule": [(0, 10)]}
    second = {"position_m": (8.0, 5.0, 2.0), "gas": "methane", "release": scheduled}
    return make_scenario(gas={"sources": [{"position_m": (5.0, 5.0, 2.0)}, second], "warm_up_s": 10.0})


@pytest.fixture
def room(make_room):
    return make_room(wind_m_s=((0.2, 0.0, 0.0),), obstacles=(("rack", (5.0, 4.0, 0.0), (6.0, 4.75, 3.0)),))


def test_sources_are_listed_with_gas_and_mean_release(scenario):
    first, second = list_true_sources(scenario)
    assert (first.position_world_m, first.gas) == ((5.0, 5.0, 2.0), "ethanol")
    assert first.release_m3_s == pytest.approx(mean_release_m3_s(scenario.gas.sources[0]))
    assert (second.gas, second.release_m3_s) == ("methane", None)


def test_the_field_is_that_of_the_run(scenario, room):
    core = FieldsCore(scenario, room)
    core.reset(Episode(seed=scenario.seed))
    core.gas.advance(25)
    now = ground_truth_from_field(core.gas, scenario, room, time_s=2.5)
    anew = compute_ground_truth(scenario, room, time_s=2.55)
    np.testing.assert_array_equal(now.mixing_ratio_ppm, anew.mixing_ratio_ppm)
    assert anew.mixing_ratio_ppm.shape == (2, 60, 40, 24)
    assert anew.gases == ("ethanol", "methane")


def test_there_is_no_gas_in_solids(scenario, room):
    truth = compute_ground_truth(scenario, room, time_s=0.0)
    assert (truth.mixing_ratio_ppm[:, ~truth.is_air] == 0.0).all()
    assert (~truth.is_air).sum() == 4 * 3 * 12
    assert truth.mixing_ratio_ppm[0].max() > 1.0


def test_the_amount_on_the_grid_is_what_was_released(scenario, make_room):
    """Integral of the mixing ratio over the room: the volume of pure gas from 12 s of release."""
    truth = compute_ground_truth(scenario, make_room(), time_s=2.0)
    volume_m3 = 1e-6 * truth.mixing_ratio_ppm[0].sum() * truth.grid.spacing_m**3
    assert volume_m3 == pytest.approx(12.0 * truth.sources[0].release_m3_s, rel=0.01)
