"""The Bayesian agents: they find what they should, say what they believe, and compile nothing in flight."""

import math
import subprocess
import sys
from functools import cache
from pathlib import Path

import briefings
import numpy as np
import pytest
from briefings import briefing, open_map
from deadlines import PROCESS_S
from ribbon_world import Ribbon, fly

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim_agents.hidden_markov.agent import HiddenMarkov
from gslcosim_agents.particle_filter.agent import ParticleFilter
from gslcosim_agents.source_term_estimation.agent import SourceTermEstimation
from gslcosim_search.beliefs import CellGrid

SourceMapAgent = load_python_agent(bundled_agents()["source_map"])

AGENTS = [SourceMapAgent, HiddenMarkov, ParticleFilter, SourceTermEstimation]
PLUME = Ribbon(ppm=5.0)
SENSORS = (("pid", "nose"), ("anemometer", "vane"))
every_agent = pytest.mark.parametrize("agent_type", AGENTS)


@cache
def flight_in_plume(agent_type, nose):
    return fly(agent_type, PLUME, nose=nose)


@every_agent
@pytest.mark.parametrize("nose", ["pid", "tgs2600"])
def test_it_follows_a_plume_to_its_source(agent_type, nose):
    assert (flight_in_plume(agent_type, nose).found_s or math.inf) < 90.0


@every_agent
def test_beliefs_are_probabilities_that_draw_near_the_source(agent_type):
    beliefs = [c.belief for c in flight_in_plume(agent_type, "pid").commands if c.belief is not None]
    assert len(beliefs) >= 5
    places_m = []
    for belief in (beliefs[0], beliefs[-1]):
        grid = CellGrid(belief.origin_m[:2], belief.cell_m, belief.probability.shape)
        p = belief.probability.to_array().astype(np.float64)
        places_m.append(float((p * np.hypot(*(grid.centres_m() - PLUME.source_m).T).reshape(grid.shape)).sum()))
    assert places_m[-1] < places_m[0]


@pytest.mark.slow
@every_agent
def test_without_gas_it_declares_nothing(agent_type):
    flight = fly(agent_type, Ribbon(has_gas=False), limit_s=60.0, found_m=0.0)
    assert not [command for command in flight.commands if command.kind == "declare_source"]


@pytest.mark.slow
@every_agent
def test_where_nothing_but_a_declaration_ends_the_run_it_declares(agent_type):
    flight = fly(agent_type, Ribbon(ppm=5.0, fades=True), limit_s=200.0, found_m=0.0)
    declared = [command.declaration for command in flight.commands if command.kind == "declare_source"]
    assert declared
    nearest_m = min(np.hypot(*(np.array(d.position_world_m[:2]) - PLUME.source_m)) for d in declared)
    assert nearest_m < 2.0


@pytest.mark.parametrize("agent_type", [SourceMapAgent, HiddenMarkov])
def test_a_source_is_never_believed_in_a_wall_of_a_granted_map(agent_type):
    known_map = open_map((20.0, 10.0), walls=[(8.0, 2.0, 9.0, 8.0)])
    flight = fly(agent_type, PLUME, known_map=known_map, start_m=(16.0, 2.0, 2.0), limit_s=30.0)
    belief = next(c.belief for c in reversed(flight.commands) if c.belief is not None)
    grid = CellGrid(belief.origin_m[:2], belief.cell_m, belief.probability.shape)
    assert belief.probability.to_array()[grid.cell_at((8.5, 5.0))] == 0.0


@pytest.mark.parametrize("parameters", [{"resampling": "copies"}, {"motion": "mean"}])
def test_the_particle_filters_other_ways_find_the_source_too(parameters):
    assert fly(ParticleFilter, PLUME, parameters=parameters).found_s is not None


@pytest.mark.parametrize("parameters", [{"planner": "information"}, {"plume": "gaussian"}, {"sensor": "normal"}])
def test_other_ways_of_source_terms_survive(parameters):
    assert fly(SourceTermEstimation, PLUME, parameters=parameters, limit_s=60.0).commands


def test_a_granted_plume_narrows_the_rate():
    settings = {"sensors": SENSORS}
    free, narrow = (
        SourceTermEstimation(briefing(**settings)),
        SourceTermEstimation(briefing(**settings, plume=briefings.PLUME)),
    )
    assert np.ptp(np.log(narrow.filter.terms[:, 3])) < np.ptp(np.log(free.filter.terms[:, 3]))
    assert briefings.PLUME.release_ppm_m3_s == pytest.approx(np.median(narrow.filter.terms[:, 3]), rel=0.2)


SPY = """
import sys
sys.path[:0] = {folders!r}
from ribbon_world import Ribbon, fly

def signatures():
    # `elementary` has names of `elementary_kernels`, each from its first use on.
    named = [(n, m) for n, m in list(sys.modules.items()) if n != "gslcosim.base.elementary"]
    kernels = [m for n, m in named if n.startswith(("gslcosim.", "gslcosim_search."))]
    found = [(m.__name__, k, v) for m in kernels for k, v in list(vars(m).items()) if hasattr(v, "signatures")]
    return {{(m, k): len(v.signatures) for m, k, v in found}}

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent

agent_type = load_python_agent(bundled_agents()[{name!r}])

class Spy(agent_type):
    def __init__(self, told):
        super().__init__(told)
        Spy.before = signatures()

fly(Spy, Ribbon(ppm=5.0), start_m=(16.0, 2.0, 2.0), limit_s=60.0)
late = sorted(key for key, n in signatures().items() if Spy.before.get(key) != n)
sys.exit(f"compiled in flight: {{late}}" if late else 0)
"""


@pytest.mark.slow
@every_agent
def test_nothing_is_compiled_in_flight(agent_type):
    """In a process of its own: what other tests have compiled would hide it."""
    program = SPY.format(
        folders=[str(Path(__file__).parent), str(Path(__file__).parents[4] / "tests" / "kit")],
        name=Path(agent_type.program).parent.name,
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=PROCESS_S
    )
    assert done.returncode == 0, done.stderr
