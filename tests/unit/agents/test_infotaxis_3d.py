import math

import numpy as np
import pytest
from briefings import briefing, observation
from ribbon_world import Ribbon, fly

from gslcosim.base.errors import MethodError
from gslcosim_agents.infotaxis_3d.agent import Infotaxis3d

PID = (("pid", "nose"), ("anemometer", "vane"))
COME = "Find the source of ethanol in the room: come within 1 m of it in at most 300 s."


def made(**parameters):
    return Infotaxis3d(briefing(sensors=PID, parameters=parameters))


def at(time_s, place_m, *, ppm=0.0):
    readings = {"nose": ppm, "vane": (0.4, math.pi)}
    return observation(tick=round(10 * time_s), position_m=place_m, readings=readings)


def chosen(agent, place_m=(7.0, 5.0, 2.0)):
    """Where the agent goes, and the outlook that it has weighed."""
    agent.observe(at(4.0, place_m))
    context = agent.search.build_context(place_m[: agent.search.grid.dimensions])
    return np.array(agent.decide(at(4.0, place_m)).position_world_m), context


def sure_of(agent, place_m):
    """Let an agent believe that the source is in one cell."""
    grid = agent.search.grid
    p = np.full(grid.shape, 1e-12)
    p[grid.cell_at(place_m)] = 1.0
    agent.search._memory.p = (p / p.sum()).reshape(-1)


def test_it_finds_the_source_of_a_plume_in_a_steady_wind():
    flight = fly(Infotaxis3d, Ribbon(half_m=0.4, spread=0.08), mission=COME, limit_s=120.0)
    assert flight.found_s is not None


def test_without_a_vane_it_says_so_at_its_briefing():
    with pytest.raises(MethodError, match="wind"):
        Infotaxis3d(briefing(sensors=(("pid", "nose"),)))


def test_a_parameter_out_of_range_is_refused():
    with pytest.raises(MethodError, match="step_m"):
        made(step_m=-1.0)


def test_its_belief_is_over_the_volume_and_small_enough_to_publish():
    belief = made().decide(at(4.0, (7.0, 5.0, 2.0))).belief
    assert belief.probability.shape == (30, 20, 16)
    assert belief.probability.to_array().size <= 65_536


@pytest.mark.parametrize(("height_m", "sign"), [(6.2, 1.0), (0.8, -1.0)])
def test_it_climbs_or_dives_to_a_source_above_or_below(height_m, sign):
    """Where arrival ends the run, the chance to find the source decides."""
    agent = Infotaxis3d(briefing(sensors=PID, mission=COME, parameters={"declares": False}))
    start_m = (7.2, 5.2, height_m - sign * 2.0)
    agent.observe(at(4.0, start_m))
    sure_of(agent, (7.2, 5.2, height_m))
    end_m = agent.decide(at(4.0, start_m)).position_world_m
    assert sign * (end_m[2] - start_m[2]) == pytest.approx(1.0)


def test_it_keeps_away_from_floor_and_ceiling():
    agent = made()
    for z_m in (0.5, 7.5):
        heights = [end[2] for end in agent.search.neighbours((7.0, 5.0, z_m))]
        assert all(0.5 <= height <= 7.5 for height in heights)
