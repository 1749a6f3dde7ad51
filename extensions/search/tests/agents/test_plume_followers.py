"""Laws of all agents that go up a plume and look for it again where they have lost it."""

import math

import pytest
from ribbon_world import Ribbon, fly
from stops_in_wind import flown, made

from gslcosim_agents.casting.agent import Casting
from gslcosim_agents.moth_inspired.agent import MothInspired
from gslcosim_agents.q_memory.agent import QMemory
from gslcosim_agents.surge_cast.agent import SurgeCast
from gslcosim_agents.surge_cast_3d.agent import SurgeCast3d
from gslcosim_agents.surge_spiral.agent import SurgeSpiral

STRAIGHT, WINDING, BLOBS = Ribbon(), Ribbon(wave_m=1.0), Ribbon(wave_m=0.8, blob_m=0.6, gap_m=1.0)
PLUMES = {
    Casting: (STRAIGHT, WINDING),
    MothInspired: (STRAIGHT,),
    QMemory: (WINDING, BLOBS),
    SurgeCast: (STRAIGHT, WINDING, BLOBS),
    SurgeCast3d: (WINDING,),
    SurgeSpiral: (STRAIGHT, WINDING),
}
# Each nose in the first plume, and one of them in the others.
FLIGHTS = [(agent, nose, plumes[0]) for agent, plumes in PLUMES.items() for nose in ("pid", "binary", "tgs2600")]
FLIGHTS += [(agent, "pid", plume) for agent, plumes in PLUMES.items() for plume in plumes[1:]]


@pytest.mark.parametrize(("agent_type", "nose", "plume"), FLIGHTS)
def test_it_comes_up_a_ribbon_of_gas(agent_type, nose, plume):
    assert fly(agent_type, plume, nose=nose, limit_s=150.0).found_s is not None


@pytest.mark.parametrize("agent_type", [Casting, MothInspired, SurgeCast, SurgeSpiral])
def test_other_seeds_give_other_sides(agent_type):
    lost = [1.0, 0.0, 0.0, 0.0, 0.0]
    assert len({tuple(flown(made(agent_type, seed=seed), lost)) for seed in range(10)}) > 1


@pytest.mark.parametrize("agent_type", [Casting, MothInspired, SurgeCast])
def test_it_declares_near_the_source_and_not_where_it_may_not(agent_type):
    def declared(**parameters):
        flight = fly(agent_type, STRAIGHT, found_m=0.0, limit_s=260.0, parameters=parameters)
        return [command.declaration for command in flight.commands if command.declaration is not None]

    (first, *_) = declared()
    assert math.dist(first.position_world_m, (2.0, 5.0, 2.0)) < 0.6
    assert declared(declares=False) == []
