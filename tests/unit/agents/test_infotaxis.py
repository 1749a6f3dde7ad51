import math

import numpy as np
import pytest
from briefings import PLUME, briefing, observation
from ribbon_world import Ribbon, fly
from scipy.special import kve

from gslcosim.base.errors import MethodError
from gslcosim_agents.infotaxis.agent import Infotaxis

PID = (("pid", "nose"), ("anemometer", "vane"))
COME = "Find the source of ethanol in the room: come within 1 m of it in at most 300 s."


def made(**parameters):
    return Infotaxis(briefing(sensors=PID, parameters=parameters))


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


def informed(agent, seed=5):
    """Let an agent hold a belief with several peaks."""
    p = np.random.default_rng(seed).random(agent.search.grid.n_cells) ** 8
    agent.search._memory.p = p / p.sum()
    return agent


def bits(p):
    p = np.asarray(p)[np.asarray(p) > 0.0]
    return float(-(p * np.log2(p)).sum())


def test_it_finds_the_source_of_a_plume_in_a_steady_wind():
    flight = fly(Infotaxis, Ribbon(half_m=0.4, spread=0.08), mission=COME, limit_s=120.0)
    assert flight.found_s is not None


def test_without_a_vane_it_says_so_at_its_briefing():
    with pytest.raises(MethodError, match="wind"):
        Infotaxis(briefing(sensors=(("pid", "nose"),)))


def test_a_parameter_out_of_range_is_refused():
    with pytest.raises(MethodError, match="step_m"):
        made(step_m=-1.0)


def test_it_goes_where_the_expected_entropy_is_least_outcome_by_outcome():
    for seed in range(3):
        place_m, context = chosen(informed(made(declares=False), seed))
        stops = context.survey([tuple(place) for place in context.places_m])
        costs = []
        for likelihood, weight in zip(stops.likelihood, stops.weight):
            after = [context.p * row for row in weight]
            costs.append(sum((context.p @ row) * bits(q / q.sum()) for row, q in zip(likelihood, after)))
        assert place_m[:2] == pytest.approx(context.places_m[int(np.argmin(costs))])


def test_it_declares_only_what_it_is_sure_of():
    agent = made()
    assert agent.decide(at(4.0, (7.0, 5.0, 2.0), ppm=1.0)).kind == "waypoint"
    sure_of(agent, (3.2, 5.2))
    assert agent.decide(at(8.0, (7.0, 5.0, 2.0), ppm=1.0)).kind == "declare_source"


def test_a_granted_plume_is_used():
    frozen = made()
    granted = Infotaxis(briefing(sensors=PID, plume=PLUME))
    assert granted.search.model().diffusivity_m2_s < 0.2 * frozen.search.model().diffusivity_m2_s


def test_what_it_decides_is_the_arithmetic_of_its_readme():
    """The formulas of the README, written down once more with plain numbers: what another language must repeat."""
    agent = informed(made(declares=False, n_headings=4), 3)
    place_m, context = chosen(agent)
    settings, model = agent.settings, agent.search.model()
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
