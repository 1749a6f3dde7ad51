"""Information-driven agents: laws that all of them keep, and for each what its objective makes it do."""

import math

import numpy as np
import pytest
from briefings import briefing, observation, task_of
from ribbon_world import Ribbon, fly
from scipy.special import kve

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim.scenario.models.success import SourceSuccess

CognitiveSearch = load_python_agent(bundled_agents()["cognitive_search"])
DualControl = load_python_agent(bundled_agents()["dual_control"])
Entrotaxis = load_python_agent(bundled_agents()["entrotaxis"])
InformationGain = load_python_agent(bundled_agents()["information_gain"])
Infotaxis = load_python_agent(bundled_agents()["infotaxis"])
Infotaxis3d = load_python_agent(bundled_agents()["infotaxis_3d"])
NStepInfotaxis = load_python_agent(bundled_agents()["n_step_infotaxis"])
SpaceAwareInfotaxis = load_python_agent(bundled_agents()["space_aware_infotaxis"])

PID = (("pid", "nose"), ("anemometer", "vane"))
COME = task_of(SourceSuccess())
AGENT_TYPES = [
    Infotaxis,
    Infotaxis3d,
    SpaceAwareInfotaxis,
    Entrotaxis,
    InformationGain,
    CognitiveSearch,
    DualControl,
    NStepInfotaxis,
]
every_agent = pytest.mark.parametrize("agent_type", AGENT_TYPES)


def made(agent_type, **parameters):
    return agent_type(briefing(sensors=PID, parameters=parameters))


def at(time_s, place_m, *, ppm=0.0):
    readings = {"nose": ppm, "vane": (0.4, math.pi)}
    return observation(tick=round(10 * time_s), position_m=place_m, readings=readings)


def chosen(agent, place_m=(7.0, 5.0, 2.0)):
    """Where the agent goes, and the outlook that it has weighed."""
    agent.observe(at(4.0, place_m))
    context = agent.build_context(place_m[: agent.grid.dimensions])
    return np.array(agent.decide(at(4.0, place_m)).position_world_m), context


def sure_of(agent, place_m):
    """Let an agent believe that the source is in one cell."""
    grid = agent.grid
    p = np.full(grid.shape, 1e-12)
    p[grid.cell_at(place_m)] = 1.0
    agent._memory.p = (p / p.sum()).reshape(-1)


def informed(agent, seed=5):
    """Let an agent hold a belief with several peaks."""
    p = np.random.default_rng(seed).random(agent.grid.n_cells) ** 8
    agent._memory.p = p / p.sum()
    return agent


def bits(p):
    p = np.asarray(p)[np.asarray(p) > 0.0]
    return float(-(p * np.log2(p)).sum())


@every_agent
def test_it_finds_the_source_of_a_plume_in_a_steady_wind(agent_type):
    flight = fly(agent_type, Ribbon(half_m=0.4, spread=0.08), task=COME, limit_s=120.0)
    assert flight.found_s is not None


@pytest.mark.parametrize(
    ("agent_type", "parameters"),
    [(SpaceAwareInfotaxis, {}), (DualControl, {}), (CognitiveSearch, {"reward": "free_energy", "temperature": 0.0})],
)
def test_a_sure_belief_is_flown_to_straight(agent_type, parameters):
    """Infotaxis has nothing to gain then; these still count the way."""
    agent = made(agent_type, declares=False, **parameters)
    sure_of(agent, (12.2, 5.2))
    place_m, _ = chosen(agent)
    assert place_m == pytest.approx((8.5, 5.0, 2.0))


@every_agent
def test_it_goes_where_the_cost_by_its_objective_is_least(agent_type):
    """What each objective is worth is held by test_objectives.py of gslcosim_search, outcome by outcome."""
    agent = informed(made(agent_type, declares=False))
    place_m, context = chosen(agent)
    cheapest = int(np.argmin(agent.costs(context)))
    assert place_m[: agent.dimensions] == pytest.approx(context.places_m[cheapest])


def test_no_two_objectives_are_the_same():
    """At one belief, the agents in the plane weigh the same stops differently."""
    agents = [made(agent_type, declares=False) for agent_type in AGENT_TYPES if agent_type.dimensions == 2]
    context = informed(agents[0]).build_context((7.0, 5.0))
    assert len({tuple(np.round(agent.costs(context), 6)) for agent in agents}) == len(agents) == 7


def test_what_it_decides_is_the_arithmetic_of_its_readme():
    """The formulas of the README, written down once more with plain numbers: what another language must repeat."""
    agent = informed(made(Infotaxis, declares=False, n_headings=4), 3)
    place_m, context = chosen(agent)
    settings, model = agent.settings, agent.model()
    speed = math.hypot(*model.wind_m_s)
    length = math.sqrt(
        model.diffusivity_m2_s * model.lifetime_s / (1 + speed**2 * model.lifetime_s / (4 * model.diffusivity_m2_s))
    )

    def log_mean(x, s):
        d = max(math.dist(x, s), 0.1)
        drift = sum(v * (a - b) for v, a, b in zip(model.wind_m_s, x, s)) / (2 * model.diffusivity_m2_s)
        return drift + math.log(kve(0, d / length)) - d / length

    speed_unit = [v / speed for v in model.wind_m_s] if speed else (1.0, 0.0)
    strength = math.log(settings.hits_at_1m) - log_mean(speed_unit, (0.0, 0.0))
    costs = []
    for x in context.places_m:
        mean = np.exp([strength + log_mean(x, s) for s in context.cells_m])
        outcomes = [settings.floor + (1 - 2 * settings.floor) * row for row in (np.exp(-mean), -np.expm1(-mean))]
        cost = 0.0
        for row in outcomes:
            after = context.p * row**settings.power
            cost += (context.p @ row) * bits(after / after.sum())
        costs.append(cost)
    assert place_m[:2] == pytest.approx(context.places_m[int(np.argmin(costs))])


def test_its_belief_is_over_the_volume_and_small_enough_to_publish():
    belief = made(Infotaxis3d).decide(at(4.0, (7.0, 5.0, 2.0))).belief
    assert belief.probability.shape == (30, 20, 16)
    assert belief.probability.to_array().size <= 65_536


@pytest.mark.parametrize(("height_m", "sign"), [(6.2, 1.0), (0.8, -1.0)])
def test_infotaxis_3d_climbs_or_dives_to_a_source_above_or_below(height_m, sign):
    """Where arrival ends the run, the chance to find the source decides."""
    agent = Infotaxis3d(briefing(sensors=PID, task=COME, parameters={"declares": False}))
    start_m = (7.2, 5.2, height_m - sign * 2.0)
    agent.observe(at(4.0, start_m))
    sure_of(agent, (7.2, 5.2, height_m))
    end_m = agent.decide(at(4.0, start_m)).position_world_m
    assert sign * (end_m[2] - start_m[2]) == pytest.approx(1.0)


@pytest.mark.parametrize("z_m", [0.5, 7.5])
def test_infotaxis_3d_keeps_away_from_floor_and_ceiling(z_m):
    assert all(0.5 <= end[2] <= 7.5 for end in made(Infotaxis3d).neighbours((7.0, 5.0, z_m)))
