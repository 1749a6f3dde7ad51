"""Searches that compare readings, in the gas that they were made for: smooth, steady, and falling off everywhere."""

import math
from dataclasses import dataclass

import pytest
from ribbon_world import fly

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim_agents.braitenberg.agent import Braitenberg
from gslcosim_agents.e_coli.agent import EColi
from gslcosim_agents.gradient.agent import Gradient

PersistentWalk = load_python_agent(bundled_agents()["persistent_walk"])

TWO_NOSES_M = ((0.0, 0.2, 0.0), (0.0, -0.2, 0.0))
ONE_NOSE_M = ((0.0, 0.0, 0.0),)
SEEDS = range(12)
LIMIT_S = 150.0


@dataclass(frozen=True, kw_only=True)
class Fog:
    """Gas around a source that falls off exponentially, and does not change."""

    source_m: tuple[float, float] = (2.0, 5.0)
    wind_m_s: float = 0.3
    ppm: float = 20.0
    scale_m: float = 2.0

    def gas_ppm(self, x_m, y_m, z_m, time_s) -> float:
        return self.ppm * math.exp(-math.dist((x_m, y_m), self.source_m) / self.scale_m)


def times_s(agent_type, nose, mounts_m=ONE_NOSE_M):
    """Restricted times to the source: the limit without success."""
    flights = [
        fly(agent_type, Fog(), nose=nose, start_m=(10.0, 5.0, 2.0), seed=seed, limit_s=LIMIT_S, mounts_m=mounts_m)
        for seed in SEEDS
    ]
    return [LIMIT_S if flight.found_s is None else flight.found_s for flight in flights]


@pytest.mark.slow
@pytest.mark.parametrize("nose", ["pid", "tgs2600"])
@pytest.mark.parametrize(
    ("agent_type", "mounts_m"), [(EColi, ONE_NOSE_M), (Gradient, ONE_NOSE_M), (Braitenberg, TWO_NOSES_M)]
)
def test_in_smooth_gas_it_finds_the_source_and_sooner_than_the_blind_walk(agent_type, mounts_m, nose):
    found_s, blind_s = times_s(agent_type, nose, mounts_m), times_s(PersistentWalk, nose)
    assert sum(time_s < LIMIT_S for time_s in found_s) >= 10
    assert sum(found_s) < 0.85 * sum(blind_s)
