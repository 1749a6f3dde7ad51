"""Prints how fast searches are run for learning: a batch of them, beside a loop over single environments.

An agent step is one tick of one agent: vehicle, wind, gas, sensors and referee. Both fly the same scenario with the
same actions in turns, in this process; only the ratio means something on another machine. Figures are medians of the
rounds. Steps per second of a processor count the time that processors were busy with it, which others on a shared
machine disturb less.
"""

# ruff: noqa: T201 - this is a script

import argparse
import json
import statistics
import time
from dataclasses import dataclass

import numpy as np

from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.search_env import SearchEnv
from gslcosim_training.stepped_run import LearningTask

SCENARIO = "warehouse_racks"
HOLD_S = 1.0
POINT_ROBOT, QUADROTOR = "agents[0].vehicle.model=holonomic", "agents[0].vehicle.model=iris"
# Obstacles are racks; sensors a MOX sensor and an anemometer, as the scenario has them.
COMMON = ("agents[0].vehicle.avoidance=none", "referee.stop.time_limit_s=100")
PLUME, TAPE = "gas.model=gaussian_plume", "gas.model=filament"
# What is run, and how it flies in the batch.
KINDS = {
    "plume": ((*COMMON, POINT_ROBOT, PLUME), "exact"),
    "filaments": ((*COMMON, POINT_ROBOT, TAPE), "exact"),
    "plume, quadrotor": ((*COMMON, QUADROTOR, PLUME), "first_order"),
    "plume, rigid quadrotor": ((*COMMON, QUADROTOR, PLUME), "rigid_body"),
}


@dataclass
class Pace:
    """What was run in how long."""

    ticks: int = 0
    decisions: int = 0
    wall_s: float = 0.0
    cpu_s: float = 0.0

    @property
    def steps_per_s(self) -> float:
        """Agent steps per second."""
        return self.ticks / self.wall_s

    @property
    def steps_per_cpu_s(self) -> float:
        """Agent steps per second of a processor."""
        return self.ticks / self.cpu_s

    @property
    def decisions_per_s(self) -> float:
        """Decisions of agents per second."""
        return self.decisions / self.wall_s


def median_of(paces: list[Pace], figure: str) -> float:
    """Return the median of a figure over rounds."""
    return statistics.median(getattr(pace, figure) for pace in paces)


def line_of(name: str, paces: list[Pace]) -> str:
    """Return the medians of rounds as a line."""
    steps, busy = median_of(paces, "steps_per_s"), median_of(paces, "steps_per_cpu_s")
    decisions = median_of(paces, "decisions_per_s")
    line = f"{steps:12,.0f} agent steps/s, {busy:12,.0f} of each processor, {decisions:12,.0f} decisions/s"
    return f"{name:42} {line}"


def fly_batch(env: BatchSearchEnv, rng: np.random.Generator, seconds: float, pace: Pace) -> None:
    """Fly a batch for some time."""
    actions = rng.uniform(-1, 1, (64, *env.action_space.shape)).astype(np.float32)
    ticks, started, busy, k = env.n_ticks, time.perf_counter(), time.process_time(), 0
    while time.perf_counter() - started < seconds:
        env.step(actions[k % 64])
        pace.decisions += env.num_envs
        k += 1
    pace.wall_s += time.perf_counter() - started
    pace.cpu_s += time.process_time() - busy
    pace.ticks += env.n_ticks - ticks


def fly_single(env: SearchEnv, rng: np.random.Generator, seconds: float, tick_s: float, pace: Pace) -> None:
    """Fly a single environment for some time; its resets count as those of the batch do."""
    started, busy = time.perf_counter(), time.process_time()
    _, info = env.reset(seed=1)
    while time.perf_counter() - started < seconds:
        before_s = info["time_s"]
        _, _, terminated, truncated, info = env.step(rng.uniform(-1, 1, env.action_space.shape).astype(np.float32))
        pace.ticks += round((info["time_s"] - before_s) / tick_s)
        pace.decisions += 1
        if terminated or truncated:
            _, info = env.reset()
    pace.wall_s += time.perf_counter() - started
    pace.cpu_s += time.process_time() - busy


def compared(name: str, n_envs: int, n_cases: int, seconds: float, rounds: int) -> dict[str, float]:
    """Fly both in turns and print the figures."""
    overrides, flying = KINDS[name]
    task = LearningTask(scenario=SCENARIO, overrides=overrides)
    cases = [task.loaded(seed) for seed in range(n_cases)]
    tick_s = cases[0].scenario.tick_ns / 1e9
    batch = BatchSearchEnv(cases, n_envs, hold_s=HOLD_S, flying=flying)
    single = SearchEnv(SCENARIO, overrides=overrides, action="velocity", hold_s=HOLD_S)
    rng = np.random.default_rng(1)
    batch.reset(seed=1)
    fly_batch(batch, rng, 0.5, Pace())
    many, one = [Pace() for _ in range(rounds)], [Pace() for _ in range(rounds)]
    for now_many, now_one in zip(many, one, strict=True):
        fly_batch(batch, rng, seconds, now_many)
        fly_single(single, rng, seconds, tick_s, now_one)
    # On a busy machine a single environment may have made no tick in a short round.
    ratios = [a.steps_per_s / b.steps_per_s for a, b in zip(many, one, strict=True) if b.ticks] or [float("nan")]
    ratio = statistics.median(ratios)
    print(line_of(f"{name}: batch of {n_envs}", many))
    print(line_of(f"{name}: single environment", one))
    print(f"{name}: ratio {ratio:,.0f} (of {rounds} rounds {min(ratios):,.0f} to {max(ratios):,.0f})")
    print(f"{name}: {batch.bytes_per_env} bytes for each search of the batch")
    figures = {
        "batch_agent_steps_per_s": median_of(many, "steps_per_s"),
        "batch_agent_steps_per_cpu_s": median_of(many, "steps_per_cpu_s"),
        "batch_decisions_per_s": median_of(many, "decisions_per_s"),
        "single_agent_steps_per_s": median_of(one, "steps_per_s"),
        "ratio": ratio,
        "bytes_per_env": batch.bytes_per_env,
    }
    batch.close()
    single.close()
    return figures


def main() -> None:
    """Print the figures of each kind."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--envs", type=int, default=10_000, help="how many searches the batch has")
    parser.add_argument("--cases", type=int, default=4, help="in how many cases they are")
    parser.add_argument("--seconds", type=float, default=2.0, help="how long each is flown in a round")
    parser.add_argument("--rounds", type=int, default=5, help="how often both are flown in turns")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS), help="what is flown")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON too")
    arguments = parser.parse_args()
    sizes = (arguments.envs, arguments.cases, arguments.seconds, arguments.rounds)
    figures = {name: compared(name, *sizes) for name in arguments.kinds}
    if arguments.json:
        print(json.dumps(figures))


if __name__ == "__main__":
    main()
