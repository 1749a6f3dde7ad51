"""How far rotorcraft of a batch are from those of full flights, with the same commands: `flying="first_order"`.

    python docs/studies/first_order_flight.py

Each series is recorded once: velocities or legs drawn from its seed, a new one each 1 to 3 s, in the quickstart's
warehouse with its wind, from the ground. It is flown in full (MuJoCo, 250 Hz), in a batch by the first-order model, and
in a batch by a point robot, which is what there is without that model. Errors are distances between centres at the
questions of the full flight, one at each tick for velocities; legs are compared at
their ends, and by how long they take.
"""

# ruff: noqa: T201 - this is a script

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.vehicles import get_vehicle
from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.batch.case_builder import lags_s
from gslcosim_training.search_env import SearchEnv
from gslcosim_training.stepped_run import LearningTask

ROTORCRAFT = ("iris", "crazyflie", "hexarotor")
SCENARIO = "warehouse_empty"
# Nothing ends a flight but its series.
COMMON = (
    "gas.model=gaussian_plume",
    "gas.sources=[{position_m: [1, 1, 6], filaments_per_s: 10}]",
    "referee.success.within_m=0.01",
    "referee.stop.time_limit_s=1000",
    "agents[0].vehicle.start_m=[7.5, 7.5, 0.2]",
    "agents[0].vehicle.hold_s=0.5",
)
ASKED_AT_EACH_TICK = "agents[0].mode=lockstep"
KINDS = ("velocity", "velocity_3d", "heading")
SPEED_M_S = 1.0
STEP_M = 2.0
ROOM_M = (15.0, 15.0, 8.0)
LAGS_S = {name: lags_s(get_vehicle(name)) for name in ROTORCRAFT}


@dataclass(frozen=True, kw_only=True)
class Way:
    """Places (n, 3) [m], velocities (n, 3) [m/s] and times (n,) [s] at the questions of a flight."""

    places_m: NDArray[np.float64]
    velocities_m_s: NDArray[np.float64]
    times_s: NDArray[np.float64]


def series_of(kind: str, n: int, seed: int) -> NDArray[np.float64]:
    """Return n actions: velocities each kept for 10 to 30 ticks, or legs."""
    rng = np.random.default_rng(seed)
    if kind == "heading":
        return rng.integers(0, 8, n)
    n_numbers = 3 if kind.endswith("3d") else 2
    actions = np.repeat(rng.uniform(-1, 1, (n, n_numbers)), rng.integers(10, 31, n), axis=0)[:n]
    return (actions * ([1, 1, 0.3] if n_numbers == 3 else 1)).astype(np.float32)


def overrides_of(vehicle: str, kind: str) -> tuple[str, ...]:
    """Return what the scenario is to be for a vehicle and a kind of action."""
    model = f"agents[0].vehicle.model={vehicle}"
    return (*COMMON, model, ASKED_AT_EACH_TICK) if kind.startswith("velocity") else (*COMMON, model)


def flown_in_full(vehicle: str, kind: str, actions: NDArray[np.float64], seed: int) -> Way:
    """Fly a series as a single flight."""
    settings = {"action": kind, "speed_m_s": SPEED_M_S, "step_m": STEP_M}
    env = SearchEnv(SCENARIO, overrides=overrides_of(vehicle, kind), **settings)
    env.reset(seed=seed)
    told = [env.step(action) for action in actions]
    env.close()
    return _way(np.array([seen for seen, *_ in told]), np.array([info["time_s"] for *_, info in told]))


def flown_in_batch(vehicle: str, kind: str, actions: NDArray[np.float64], seed: int) -> Way:
    """Fly a series in a batch."""
    case = LearningTask(scenario=SCENARIO, overrides=overrides_of(vehicle, kind)).loaded(seed)
    settings = {"action": kind, "speed_m_s": SPEED_M_S, "step_m": STEP_M}
    batch = BatchSearchEnv([case], 1, flying="first_order", n_threads=1, **settings)
    batch.reset(seed=1, options={"seeds": [seed]})
    told = [batch.step(action[None]) for action in actions]
    batch.close()
    return _way(np.array([seen[0] for seen, *_ in told]), np.array([info["time_s"][0] for *_, info in told]))


# The first numbers of an observation are shares of the room, the sixth to eighth tanh of speeds in units of 2 m/s.
def _way(seen: NDArray[np.float32], times_s: NDArray[np.float64]) -> Way:
    half_m = np.array(ROOM_M) / 2
    return Way(
        places_m=half_m + seen[:, :3].astype(np.float64) * half_m,
        velocities_m_s=2.0 * np.arctanh(seen[:, 5:8].astype(np.float64)),
        times_s=times_s,
    )


def line_of(name: str, ways: Sequence[tuple[Way, Way]]) -> str:
    """Return how far ways of a model are from those of full flights, as a line of a table."""
    gaps_m = np.concatenate([np.linalg.norm(a.places_m - b.places_m, axis=1) for a, b in ways])
    gaps_m_s = np.concatenate([np.linalg.norm(a.velocities_m_s - b.velocities_m_s, axis=1) for a, b in ways])
    lates_s = np.concatenate([np.diff(a.times_s) - np.diff(b.times_s) for a, b in ways])
    return (
        f"| {name} | {np.sqrt(np.mean(gaps_m**2)):.3f} | {np.quantile(gaps_m, 0.95):.3f} | {gaps_m.max():.3f} "
        f"| {np.sqrt(np.mean(gaps_m_s**2)):.3f} | {np.sqrt(np.mean(lates_s**2)):.2f} |"
    )


def main() -> None:
    """Print a table of errors for each vehicle and kind of action."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="how many series of each kind")
    parser.add_argument("--steps", type=int, default=600, help="how many commands a series of velocities has")
    parser.add_argument("--vehicles", nargs="+", default=list(ROTORCRAFT), choices=ROTORCRAFT)
    arguments = parser.parse_args()
    print("| vehicle, actions, model | place, rms [m] | 95 % [m] | most [m] | velocity, rms [m/s] | step, rms [s] |")
    print("|---|---|---|---|---|---|")
    for vehicle in arguments.vehicles:
        for kind in KINDS:
            n = arguments.steps if kind.startswith("velocity") else arguments.steps // 20
            many = [(series_of(kind, n, seed), seed) for seed in range(arguments.seeds)]
            full = [flown_in_full(vehicle, kind, *one) for one in many]
            for model in (vehicle, "holonomic"):
                name = "point robot" if model == "holonomic" else "first order"
                ways = [flown_in_batch(model, kind, *one) for one in many]
                print(line_of(f"{vehicle}, {kind}, {name}", list(zip(ways, full, strict=True))), flush=True)
    for vehicle in arguments.vehicles:
        print(f"{vehicle}: lags of {LAGS_S[vehicle][0]:.3f} s sideways, {LAGS_S[vehicle][1]:.3f} s upwards")


if __name__ == "__main__":
    main()
