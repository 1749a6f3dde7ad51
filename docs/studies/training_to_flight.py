"""Loss from training to flight: learned and hand-made agents on the same cases, with intervals.

    python docs/studies/training_to_flight.py --n 100

Every agent meets the same cases of the split `test` of each family, with the same starts, gas and noise, in these
places:

- `batch`: the batch environment, policies only;
- `holonomic`: the same searches as single flights in this process;
- `avoiding`: the same where a planner that knows the map leads waypoints around obstacles, where there are some:
  agents that look for none need it;
- `quadrotor`: the same with an Iris in place of the holonomic vehicle, from the ground, and with that planner;

and in rooms, winds and gas that no policy was trained on, from starts drawn again, with the holonomic vehicle:

- `elsewhere_open`: the quickstart's warehouse with its young wind, a plume that meanders, an open field that gusts, and
  a hall whose wind has settled;
- `elsewhere_cluttered`: two warehouses with racks, one of them settled, nine rooms with passages, and a furnished flat,
  all of the suite `methods`.

A policy flies where the cases have what it observes.
Success comes with Wilson's interval, the restricted mean time (failures count the time limit) with Student's, and
differences are those of pairs, with bootstrap intervals: of a learned agent to each hand-made one in the same place,
and of each place to the one before it.
"""

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.bundled import bundled_agents, bundled_families, bundled_folder
from gslcosim.environment.positions import find_position_problems
from gslcosim.runtime.run import run_scenario
from gslcosim.scenario.loader import LoadedScenario
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.statistics.pairs import paired_difference
from gslcosim_bench.statistics.rates import wilson
from gslcosim_bench.statistics.times import counted_times, restricted_mean
from gslcosim_search.learned.policy import Policy
from gslcosim_search.learned.policy_agent import bundled_policies
from gslcosim_search.learned.policy_files import load_policy
from gslcosim_search.learned.wind_frame import asks_wind_frame
from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.family import load_family
from gslcosim_training.stepped_run import LearningTask

# The best hand-made ones, two that smell nothing, and two weak ones.
HAND_MADE = ("sweep", "surge_cast", "surge_spiral", "particle_filter", "persistent_walk", "e_coli", "dung_beetle")
# The agent that flies any policy has the one of another agent.
PILOT = "learned"
PLACES = ("batch", "holonomic", "avoiding", "quadrotor")
QUADROTOR = "iris"
# Families whose halls have something to go around.
CLUTTERED = ("cluttered_halls",)
EQUIPPED = (
    "agents[0].sensors=[{model: tgs2600, name: nose}, {model: anemometer, name: wind}, {model: four_range_finders, "
    "name: ranges}]",
    "agents[0].vehicle.hold_s=0.5",
)
METHODS = bundled_folder("suites") / "methods"
ELSEWHERE: dict[str, tuple[tuple[str | Path, tuple[str, ...]], ...]] = {
    "elsewhere_open": (
        (
            "warehouse_empty",
            (
                "agents[0].vehicle={model: holonomic, start_m: random, search_height_m: 2, hold_s: 0.5}",
                "gas.turbulence.kind=none",
                EQUIPPED[0],
            ),
        ),
        *((METHODS / f"{name}.yaml", EQUIPPED) for name in ("meander", "field", "settled")),
    ),
    "elsewhere_cluttered": tuple(
        (METHODS / f"{name}.yaml", EQUIPPED) for name in ("racks", "racks_settled", "rooms", "flat")
    ),
}
FIRST_SEED = 60_000

# Where an agent flew: cases, place, agent.
Key = tuple[str, str, str]


@dataclass(frozen=True, kw_only=True)
class Searches:
    """Outcomes of an agent's searches in one place, in the order of its cases."""

    success: NDArray[np.bool_]
    counted_s: NDArray[np.float64]
    limit_s: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Flier:
    """An agent: its name in the tables, the bundled agent that flies, its parameters, and its policy if it has one."""

    name: str
    python: str
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    policy: Policy | None = None


def learned_fliers() -> dict[str, Flier]:
    """Return all agents that have learned, by name: bundled ones, and policies that lie beside their families."""
    found: dict[str, Flier] = {}
    for name, file in bundled_policies(bundled_agents()[PILOT].parents[1]).items():
        if name != PILOT:
            found[name] = Flier(name=name, python=name, policy=load_policy(file))
    for file in sorted(bundled_folder("families").glob("*/*.npz")):
        parameters = {"policy": str(file)}
        found[file.stem] = Flier(name=file.stem, python=PILOT, parameters=parameters, policy=load_policy(file))
    return found


def can_fly(flier: Flier, cases: Sequence[LoadedScenario]) -> bool:
    """Return whether the cases' sensors tell all that a policy observes."""
    names = {sensor.name for sensor in cases[0].scenario.agents[0].sensors}
    observed = () if flier.policy is None else flier.policy.observation_names
    # An estimate of a mixing ratio has the name of its sensor before its own.
    return all(any(part.startswith(name) for name in names) for part in observed if "." in part)


def flown(loaded: Sequence[LoadedScenario], flier: Flier) -> Searches:
    """Fly an agent through cases in this process."""
    rows = []
    for one in loaded:
        spec = one.scenario.agents[0]
        start = spec.start.model_copy(update={"python": flier.python})
        agent = spec.model_copy(update={"start": start, "parameters": dict(flier.parameters)})
        recording = one.scenario.recording.model_copy(update={"enabled": False})
        scenario = one.scenario.model_copy(update={"agents": (agent,), "recording": recording})
        with tempfile.TemporaryDirectory() as runs_dir:
            result = run_scenario(replace(one, scenario=scenario), runs_dir=Path(runs_dir), processes="one").result
        if not result["valid"] or result["faults"]:
            raise RuntimeError(f"expected a valid flight of {flier.name} in {scenario.name}, was {result}")
        limit_s = scenario.referee.stop.time_limit_s
        rows.append((result["agents"][0]["outcome"] == "success", result["sim_time_s"], limit_s))
    return searches_of(rows)


def stepped(loaded: Sequence[LoadedScenario], policy: Policy) -> Searches:
    """Fly a policy through cases in the batch environment."""
    n, settings = len(loaded), policy.action
    envs = BatchSearchEnv(
        loaded,
        n,
        action=settings.kind,
        step_m=settings.step_m,
        speed_m_s=settings.speed_m_s,
        hold_s=settings.hold_s,
        frame=settings.frame,
        shield_m=settings.shield_m,
        has_wind_frame=asks_wind_frame(policy.observation_names),
    )
    seeds = np.array([one.scenario.seed for one in loaded])
    observed, _ = envs.reset(seed=0, options={"cases": np.arange(n), "seeds": seeds})
    places = np.array([envs.observation_names.index(name) for name in policy.observation_names])
    memory, goes_on = policy.memory(n), np.ones(n, np.bool_)
    success, time_s = np.zeros(n, np.bool_), np.zeros(n)
    while goes_on.any():
        actions, memory = policy.act(observed[:, places], memory)
        observed, _, terminated, truncated, infos = envs.step(actions)
        ends = (terminated | truncated) & goes_on
        if ends.any():
            success[ends], time_s[ends] = infos["success"][ends], infos["time_s"][ends]
        goes_on &= ~ends
    envs.close()
    limits_s = [one.scenario.referee.stop.time_limit_s for one in loaded]
    return searches_of(list(zip(success.tolist(), time_s.tolist(), limits_s, strict=True)))


def searches_of(rows: Sequence[tuple[bool, float, float]]) -> Searches:
    """Return searches from success, time [s] and time limit [s] of each."""
    success, time_s, limit_s = (np.array(column) for column in zip(*rows, strict=True))
    return Searches(success=success, counted_s=counted_times(time_s, success, limit_s), limit_s=limit_s)


def cases_of(cases: str, place: str, n: int) -> list[LoadedScenario]:
    """Return n cases of a family, or of `ELSEWHERE`, in a place."""
    if cases in ELSEWHERE:
        tasks = [LearningTask(scenario=source, overrides=overrides) for source, overrides in ELSEWHERE[cases]]
        return [tasks[i % len(tasks)].loaded(FIRST_SEED + i) for i in range(n)]
    changes = {
        "avoiding": {"avoidance": "2d"},
        "quadrotor": {"model": QUADROTOR} | ({"avoidance": "2d"} if cases in CLUTTERED else {}),
    }.get(place, {})
    family, chosen = load_family(cases), list[LoadedScenario]()
    for i in range(family.spec.seeds.test.count):
        one = family.case("test", i)
        # All places have the same cases: those in which a quadrotor, which is larger, has room at the start, too.
        if cases not in CLUTTERED or has_room(with_vehicle(one, {"model": QUADROTOR})):
            chosen.append(with_vehicle(one, changes))
        if len(chosen) == n:
            break
    return chosen


def has_room(one: LoadedScenario) -> bool:
    """Return whether the vehicle of a case touches nothing at its start."""
    return not find_position_problems(one.scenario, scenario_dir=one.directory)


def with_vehicle(one: LoadedScenario, changes: Mapping[str, str]) -> LoadedScenario:
    """Return a case whose vehicle is another, or avoids obstacles, in the same place."""
    agent = one.scenario.agents[0]
    vehicle = agent.vehicle.model_copy(update=dict(changes))
    scenario = one.scenario.model_copy(update={"agents": (agent.model_copy(update={"vehicle": vehicle}),)})
    return replace(one, scenario=scenario)


def main() -> None:
    """Fly all, and print the tables."""
    every = (*bundled_families(), *ELSEWHERE)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=100, help="cases of each kind")
    parser.add_argument("--cases", nargs="*", choices=every, default=every, help="cases to fly (default: all)")
    parser.add_argument("--places", nargs="*", choices=PLACES, default=PLACES, help="places to fly in (default: all)")
    parser.add_argument("--agents", nargs="*", help="learned agents (default: all)")
    given = parser.parse_args()
    learned = learned_fliers()
    if given.agents:
        learned = {name: learned[name] for name in given.agents}
    found: dict[Key, Searches] = {}
    for cases in given.cases:
        places = [place for place in given.places if place != "avoiding" or cases in CLUTTERED]
        for place in places if cases not in ELSEWHERE else ("holonomic",):
            loaded = cases_of(cases, place, given.n)
            hand_made = [Flier(name=name, python=name) for name in HAND_MADE if place != "batch"]
            for flier in (*learned.values(), *hand_made):
                if not can_fly(flier, loaded):
                    continue
                if place != "batch":
                    own = flown(loaded, flier)
                elif flier.policy is not None:
                    own = stepped(loaded, flier.policy)
                else:
                    continue
                found[cases, place, flier.name] = own
                sys.stderr.write(f"{cases}: {place}: {flier.name}: {own.success.sum()} of {len(loaded)}\n")
    sys.stdout.write(f"{rates(found)}\n{against_hand_made(found)}\n{losses(found)}")


def rates(found: Mapping[Key, Searches]) -> str:
    """Return success and restricted mean time of each agent in each place."""
    lines = ["| cases | place | agent | n | success, % | restricted mean time, s |", "|---|---|---|---|---|---|"]
    for (cases, place, name), own in found.items():
        success = wilson(int(own.success.sum()), len(own.success))
        mean_s = restricted_mean(own.counted_s, own.success, own.limit_s)
        lines.append(f"| {cases} | {place} | `{name}` | {success.n} | {shown(success, 100)} | {shown(mean_s)} |")
    return "\n".join(lines) + "\n"


def against_hand_made(found: Mapping[Key, Searches]) -> str:
    """Return by how much learned agents differ from hand-made ones in the same cases."""
    lines = ["| cases | place | agent | beside | more success, points | sooner, s |", "|---|---|---|---|---|---|"]
    for cases, place, name in (key for key in found if key[2] not in HAND_MADE):
        for other in (other for other in HAND_MADE if (cases, place, other) in found):
            cells = shown_differences(found[cases, place, name], found[cases, place, other])
            lines.append(f"| {cases} | {place} | `{name}` | `{other}` | {cells} |")
    return "\n".join(lines) + "\n"


def losses(found: Mapping[Key, Searches]) -> str:
    """Return by how much learned agents do better or worse in a place than in the one before it, in the same cases."""
    lines = ["| cases | agent | from | to | more success, points | sooner, s |", "|---|---|---|---|---|---|"]
    for cases, name in dict.fromkeys((key[0], key[2]) for key in found if key[2] not in HAND_MADE):
        for before, after in pairwise(place for place in PLACES if (cases, place, name) in found):
            cells = shown_differences(found[cases, after, name], found[cases, before, name])
            lines.append(f"| {cases} | `{name}` | {before} | {after} | {cells} |")
    return "\n".join(lines) + "\n"


def shown_differences(a: Searches, b: Searches) -> str:
    """Return by how much more often a finds sources than b, in points, and by how much sooner, as cells of a table."""
    success = paired_difference(a.success.astype(float), b.success.astype(float))
    sooner_s = paired_difference(b.counted_s, a.counted_s)
    return f"{shown(success, 100, sign='+')} | {shown(sooner_s, sign='+')}"


def shown(figure: Estimate, scale: float = 1.0, sign: str = "") -> str:
    """Return a figure with its interval."""
    value, low, high = (f"{scale * part:{sign}.0f}" for part in (figure.value, figure.low, figure.high))
    return f"{value} [{low}, {high}]"


if __name__ == "__main__":
    main()
