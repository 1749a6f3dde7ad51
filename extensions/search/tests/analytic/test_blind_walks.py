"""How often blind walks find a source by luck, against an independent simulation: the floor under every search.

A room of 15 x 15 m, nine starts, 300 s, success within 1 m; the first decision after 7 s, legs of 1 m that take 3 s,
then a hold. Figures by 4000 runs for each start, of another implementation.
"""

import math
import random
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from briefings import briefing, observation

from gslcosim.agent_kit import Agent
from gslcosim.base.bundled import bundled_agents
from gslcosim.contract.messages import Bounds
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim_agents.e_coli.agent import EColi
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.random_walks import RunAndTumble

PersistentWalk = load_python_agent(bundled_agents()["persistent_walk"])
RandomWalker = load_python_agent(bundled_agents()["random_walker"])

SIZE_M = (15.0, 15.0, 8.0)
MARGIN_M, FIRST_S, LEG_S, LIMIT_S, RADIUS_M = 0.3, 7.0, 3.0, 300.0, 1.0
STARTS_M = [(x_m, y_m) for y_m in (3.0, 7.5, 12.0) for x_m in (3.0, 7.5, 12.0)]
ODD_M, EVEN_M = (5.0, 1.0), (1.0, 10.0)
ROOM = LegSpace.within(Bounds(min_m=(0.0, 0.0, 0.0), max_m=SIZE_M), MARGIN_M)
# Percent of runs that succeed, source (5, 1): holds of 2 s by start, and in all by (persistence, hold).
BY_START = (51.5, 39.6, 11.6, 13.6, 10.6, 4.4, 2.6, 1.8, 0.8)
SUCCESS = {(0.0, 2.0): 15.2, (0.0, 0.1): 21.3, (0.5, 2.0): 23.2, (0.5, 0.1): 33.8, (0.9, 2.0): 34.4, (0.9, 0.1): 49.9}
MEAN_TIME_S = 132.0

NextEnd = Callable[[Sequence[float]], Sequence[float]]


def time_to_source_s(next_end_m: NextEnd, start_m, *, hold_s: float, source_m=ODD_M) -> float | None:
    """Fly straight legs until one passes the source, in the plane or in space; None without success."""
    here_m, time_s = tuple(start_m), FIRST_S
    while time_s < LIMIT_S:
        end_m = next_end_m(here_m)
        step_m = [b - a for a, b in zip(here_m, end_m)]
        flown = min(1.0, (LIMIT_S - time_s) / LEG_S)
        nearest = sum((c - a) * d for a, c, d in zip(here_m, source_m, step_m)) / max(1e-12, sum(d * d for d in step_m))
        t = min(flown, max(0.0, nearest))
        if math.dist([a + t * d for a, d in zip(here_m, step_m)], source_m) < RADIUS_M:
            return time_s + t * LEG_S
        here_m, time_s = tuple(end_m), time_s + LEG_S + hold_s
    return None


def walker(seed: int, persistence: float) -> NextEnd:
    draws = RandomStream(seed)
    walk = RunAndTumble(ROOM, draws, leg_m=1.0)
    return lambda here_m: walk.next_end_m(here_m, keeps=persistence > 0.0 and draws.fraction() < persistence)


def times_s(new_walk: Callable[[int], NextEnd], n_runs: int, *, hold_s: float, source_m=ODD_M, height_m=()):
    """Return (9, n_runs) times to the source, NaN without success."""
    found = [
        [time_to_source_s(new_walk(10_000 * i + j), (*start_m, *height_m), hold_s=hold_s, source_m=source_m)
         for j in range(n_runs)]
        for i, start_m in enumerate(STARTS_M)
    ]  # fmt: skip
    return np.array(found, dtype=float)


def percent_and_error(times) -> tuple[float, float]:
    """Return the success of all starts together and its standard error, in percent."""
    rates = np.isfinite(times).mean(axis=1)
    error = math.sqrt(float((rates * (1.0 - rates)).sum()) / times.shape[1]) / len(rates)
    return 100.0 * float(rates.mean()), 100.0 * error


def check(times, expected_percent: float) -> None:
    percent, error = percent_and_error(times)
    # The figures have an error of their own, and one decimal.
    assert percent == pytest.approx(expected_percent, abs=3.0 * math.hypot(error, 0.2))


def agent_walk(agent_type: type[Agent], readings: Callable[[], dict[str, float]], hold_s=2.0, **changes):
    """Return walks by agents themselves, which see whatever `readings` gives."""

    def new(seed: int) -> NextEnd:
        parameters = {"wall_margin_m": MARGIN_M, **changes}
        agent_briefing = briefing(size_m=SIZE_M, seed=seed, parameters=parameters, search_height_m=4.0, hold_s=hold_s)
        agent, tick = agent_type(agent_briefing), 0

        def next_end_m(here_m: Sequence[float]) -> Sequence[float]:
            nonlocal tick
            tick += 50
            place_m = (*here_m, 4.0)[:3]
            command = agent.decide(observation(tick=tick, position_m=place_m, readings=readings()))
            assert command.position_world_m is not None
            return command.position_world_m[: len(here_m)]

        return next_end_m

    return new


def clean_air() -> dict[str, float]:
    return {"nose": 50_000.0, "nose_ppm": 0.0}


def noisy_air(seed: int) -> Callable[[], dict[str, float]]:
    rng = random.Random(seed)
    return lambda: {"nose": 50_000.0 * (1.0 + 0.001 * rng.gauss(0.0, 1.0)), "nose_ppm": 0.0}


@pytest.mark.slow
@pytest.mark.parametrize(("persistence", "hold_s"), SUCCESS)
def test_success_without_gas_is_that_of_the_independent_simulation(persistence, hold_s):
    check(times_s(lambda seed: walker(seed, persistence), 80, hold_s=hold_s), SUCCESS[persistence, hold_s])


@pytest.mark.slow
def test_success_falls_with_the_distance_of_the_start_as_it_does_there():
    """Chi squared over the nine starts, and the mean time of those that succeed."""
    n = 150
    times = times_s(lambda seed: walker(seed, 0.0), n, hold_s=2.0)
    found, expected = np.isfinite(times).sum(axis=1), np.array(BY_START) / 100.0
    chi_squared = ((found - n * expected) ** 2 / (n * expected * (1.0 - expected))).sum()
    assert chi_squared < 27.9  # 9 degrees of freedom, 0.1 %
    finite = times[np.isfinite(times)]
    assert finite.mean() == pytest.approx(MEAN_TIME_S, abs=3.0 * finite.std() / math.sqrt(len(finite)))


@pytest.mark.slow
def test_a_blind_walk_in_space_hardly_ever_finds_the_source():
    """From 4 m, the source at 2 m, judged in space, with climbs of at most 0.3 m."""

    def new(seed: int) -> NextEnd:
        walk = RunAndTumble(ROOM, RandomStream(seed), leg_m=1.0, most_climb_m=0.3)
        return lambda here_m: walk.next_end_m(here_m, keeps=False)

    check(times_s(new, 120, hold_s=2.0, source_m=(*ODD_M, 2.0), height_m=(4.0,)), 2.2)


def ends_m(new_walk, seed: int, n=60):
    next_end_m, here_m, found = new_walk(seed), STARTS_M[4], []
    for _ in range(n):
        here_m = next_end_m(here_m)
        found.append(tuple(here_m))
    return found


def test_the_walkers_fly_these_walks():
    walked = ends_m(lambda seed: walker(seed, 0.0), 3)
    assert ends_m(agent_walk(RandomWalker, clean_air), 3) == walked
    kept = ends_m(agent_walk(PersistentWalk, clean_air, persistence=0.9), 3)
    assert kept == ends_m(lambda seed: walker(seed, 0.9), 3)
    assert kept != walked


def test_e_coli_without_gas_and_without_noise_is_the_random_walker():
    """Not only as often successful: the same legs from the same seed."""
    assert ends_m(agent_walk(EColi, clean_air), 5) == ends_m(agent_walk(RandomWalker, clean_air), 5)


def share_kept(new_walk, n=600) -> float:
    """Which part of the legs has the direction of the one before; those at walls count as turned."""
    places_m = np.array([STARTS_M[4], *ends_m(new_walk, 7, n)])
    headings = np.arctan2(*np.diff(places_m, axis=0).T)
    return float(np.mean(np.abs(np.diff(headings)) < 0.01))


def test_noise_is_a_coin_without_a_dead_band_and_nothing_with_it():
    assert share_kept(agent_walk(EColi, noisy_air(1), eps=0.0)) == pytest.approx(0.48, abs=0.06)
    assert share_kept(agent_walk(EColi, noisy_air(1))) < 0.01
