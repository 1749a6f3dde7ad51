"""Learns what `agents/qmdp` knows: how often which level of gas is met where, and where to go with a belief.

Run with `python docs/studies/train_qmdp.py` (some minutes on one core); it rewrites `agents/qmdp/plumes.npz` and prints
what is in it. With `--episodes 400` it instead flies the policies of that file in their own model and prints how they
do.

The plumes are Farrell's, in an open field, at five mean winds with gusts of a third of them, 150 s after the source
opened and later; the source is as high as the vehicle, half a metre or a metre away from it. No bundled scenario is
among them. At each offset from the source the share of holds of two seconds is counted whose mean is above no
threshold, one, or two. The table is made even to both sides, blurred by 15 degrees for what an agent does not know of
the wind, smoothed, and floored. On it, over moves of a metre, value iteration gives the policy `qmdp` and Perseus the
policy `perseus`.
"""

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pomdp_planning import (
    Pomdp,
    find_successors,
    improve_by_perseus,
    sample_beliefs,
    solve_by_value_iteration,
    update_belief,
)

from gslcosim.environment.model import Environment, Grid, WindFrames
from gslcosim.scenario.models.scenario import Scenario
from gslcosim_search.information.pomdp import OffsetGrid, PlumeTable, offsets_m
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_services.fields.gas_field import GasField, PointGrid
from gslcosim_services.fields.mixing_ratio import CUTOFF_SIGMA

Floats = NDArray[np.float64]

TABLE = Path(__file__).parents[2] / "agents" / "qmdp" / "plumes.npz"
SEED = 20_240_601
WINDS_M_S = (0.08, 0.15, 0.3, 0.6, 1.0)
# In the middle of the field; a third of the mean wind at its corners.
GUST_FRAC = 0.083
# Half a metre apart, like the cells.
N_HEIGHTS = 3
THRESHOLDS_PPM = (0.1, 1.0)
FLOOR_FRAC = 1e-3
BLUR_RAD = np.radians(15.0)
SMOOTHING_CELLS = 1.0
SOURCE_M = (16.0, 20.0, 3.0)
ROOM_CELLS, ROOM_CELL_M = (112, 80, 12), 0.5
GRID = OffsetGrid(first_m=(-6.0, -14.0), cell_m=0.5, shape=(81, 57))
POLICY_GRID = OffsetGrid(first_m=(-22.0, -22.0), cell_m=1.0, shape=(45, 45))
STEP_S, WARM_UP_S, WATCHED_S, HOLD_S = 0.1, 150.0, 300.0, 2.0
SAMPLES_PER_HOLD = 4
DISCOUNT = 0.97
MAX_MOVES, STUCK_VISITS, ESCAPE_MOVES = 200, 3, 8
FOUND_WITHIN_M = 1.0
N_BELIEFS, N_STEPS, N_STAGES = 600, 100, 40


def scenario(wind_m_s: float, seed: int) -> Scenario:
    """Return a plume of the family."""
    return Scenario.model_validate(
        {
            "schema": "gslcosim/scenario/1",
            "name": "train_qmdp",
            "seed": seed,
            "environment": {"layout": {}},
            "gas": {
                "model": "farrell",
                "gas": "ethanol",
                "sources": [{"position_m": SOURCE_M, "filaments_per_s": 10, "release": {"kind": "poisson"}}],
                "step_s": STEP_S,
                "eddy_diffusivity_m2_s": 0.005,
                "farrell": {"wind_m_s": (wind_m_s, 0.0, 0.0), "gust_std_m_s": GUST_FRAC * wind_m_s},
            },
            "agents": [
                {
                    "name": "nobody",
                    "start": {"attach": True},
                    "vehicle": {"start_m": (1, 1, 0.2)},
                    "sensors": [{"model": "pid", "name": "nose"}],
                }
            ],
        }
    )


def open_field() -> Environment:
    """Return a field without walls."""
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=ROOM_CELL_M, shape=ROOM_CELLS)
    return Environment(
        name="field",
        grid=grid,
        occupancy=np.zeros(grid.shape, np.uint8),
        wind=WindFrames(velocity_m_s=np.zeros((1, *grid.shape, 3), np.float32)),
        boxes=(),
        openings=(),
        content_hash="field",
    )


def counted_levels(wind_m_s: float, seed: int) -> Floats:
    """Return the (n_levels, cells of `GRID`) share of holds at each level in one plume."""
    field = build_gas_field(scenario(wind_m_s, seed), open_field())
    field.advance(round(WARM_UP_S / STEP_S))
    counts, n_holds = np.zeros((len(THRESHOLDS_PPM) + 1, GRID.n_cells)), round(WATCHED_S / HOLD_S)
    for _ in range(n_holds):
        for ppm in held_ppm(field):
            level = (ppm[None] > np.array(THRESHOLDS_PPM)[:, None]).sum(axis=0)
            counts += np.arange(len(counts))[:, None] == level
    return counts / (n_holds * N_HEIGHTS)


def held_ppm(field: GasField) -> Floats:
    """Return the (n_heights, cells of `GRID`) mean mixing ratio [ppm] over the next hold."""
    along_m, across_m = GRID.first_m
    points = PointGrid(
        first_m=(SOURCE_M[0] + along_m, SOURCE_M[1] + across_m, SOURCE_M[2]),
        spacing_m=GRID.cell_m,
        shape=(*GRID.shape, N_HEIGHTS),
    )
    total = np.zeros(points.shape)
    for _ in range(SAMPLES_PER_HOLD):
        field.advance(round(HOLD_S / SAMPLES_PER_HOLD / STEP_S))
        total += field.mixing_ratio_ppm_on_grid(points, cutoff_sigma=CUTOFF_SIGMA)
    return total.reshape(-1, N_HEIGHTS).T / SAMPLES_PER_HOLD


def prepared(level_frac: Floats) -> Floats:
    """Return a table made even to both sides, blurred, smoothed and floored; each cell sums to 1."""
    even = level_frac.reshape(-1, *GRID.shape)
    even = (even + even[:, :, ::-1]) / 2.0
    angles_rad = BLUR_RAD * np.linspace(-2.0, 2.0, 17)
    weights = np.exp(-0.5 * (angles_rad / BLUR_RAD) ** 2)
    turned = [GRID.looked_up(even.reshape(len(even), -1), _turned(angle_rad)) for angle_rad in angles_rad]
    blurred = np.einsum("a,alc->lc", weights / weights.sum(), np.array(turned)).reshape(even.shape)
    smooth = np.maximum(_smoothed(blurred), FLOOR_FRAC).reshape(len(even), -1)
    return smooth / smooth.sum(axis=0)


def _turned(angle_rad: float) -> Floats:
    return offsets_m(-GRID.centres_m(), (0.0, 0.0), angle_rad)


# A Gaussian over both axes; the table goes on beyond its edge as it is there.
def _smoothed(table: Floats) -> Floats:
    reach = 3
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / SMOOTHING_CELLS) ** 2)
    kernel /= kernel.sum()
    for axis in (1, 2):
        widths = [(reach, reach) if k == axis else (0, 0) for k in range(3)]
        padded, n = np.pad(table, widths, mode="edge"), table.shape[axis]
        table = np.sum(
            [kernel[k] * np.take(padded, np.arange(k, k + n), axis=axis) for k in range(2 * reach + 1)], axis=0
        )
    return table


def problem_of(level_frac: Floats) -> Pomdp:
    """Return the search for a source as a decision problem over the offset: a metre a move, found within a metre."""
    centres_m = POLICY_GRID.centres_m()
    observed = GRID.looked_up(level_frac, centres_m)
    is_found = np.hypot(*centres_m.T) <= FOUND_WITHIN_M
    successor = find_successors(POLICY_GRID)
    return Pomdp(
        successor=successor,
        observed=observed / observed.sum(axis=0),
        reward=is_found[successor] * 1.0,
        is_terminal=is_found,
        discount=DISCOUNT,
    )


def first_belief(rng: np.random.Generator) -> Floats:
    """Return the belief of a searcher in a room of any size and wind that knows nothing but where it is itself."""
    size_m = rng.uniform((8.0, 8.0), (18.0, 16.0))
    x_m, y_m = np.meshgrid(*(np.arange(0.5, side_m) for side_m in size_m), indexing="ij")
    places_m = np.stack([x_m.ravel(), y_m.ravel()], axis=1)
    position_m = rng.uniform((1.0, 1.0), size_m - 1.0)
    seen = offsets_m(places_m, (position_m[0], position_m[1]), rng.uniform(-np.pi, np.pi))
    belief = POLICY_GRID.gathered(seen, np.ones(len(seen)))
    belief[np.hypot(*POLICY_GRID.centres_m().T) <= FOUND_WITHIN_M] = 0.0
    return belief / belief.sum()


def with_perseus(problem: Pomdp, q: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Return the linear functions of Perseus and their actions."""
    rng = np.random.default_rng(SEED)
    beliefs = sample_beliefs(problem, first_belief, q, rng, n_beliefs=N_BELIEFS, n_steps=N_STEPS)
    vectors, actions = np.zeros((1, problem.n_states)), np.zeros(1, np.int64)
    for stage in range(N_STAGES):
        vectors, actions = improve_by_perseus(problem, beliefs, vectors, actions, rng)
        value = float((beliefs @ vectors.T).max(axis=1).mean())
        sys.stdout.write(f"stage {stage:3}: {len(vectors):4} vectors, mean value {value:.4f}\n")
        sys.stdout.flush()
    used = np.unique((beliefs @ vectors.T).argmax(axis=1))
    return vectors[used], actions[used]


def train() -> None:
    """Write the table with both policies."""
    tables = [counted_levels(wind_m_s, SEED + i) for i, wind_m_s in enumerate(WINDS_M_S)]
    for wind_m_s, table in zip(WINDS_M_S, tables, strict=True):
        sys.stdout.write(f"wind {wind_m_s:4} m/s: gas on the axis " + _axis_text(table) + "\n")
    level_frac = prepared(np.mean(tables, axis=0))
    sys.stdout.write("prepared:     gas on the axis " + _axis_text(level_frac) + "\n")
    problem = problem_of(level_frac)
    q = solve_by_value_iteration(problem)
    vectors, actions = with_perseus(problem, q)
    table = PlumeTable(
        thresholds_ppm=np.array(THRESHOLDS_PPM),
        grid=GRID,
        level_frac=level_frac,
        policy_grid=POLICY_GRID,
        vectors={"qmdp": q, "perseus": vectors},
        actions={"qmdp": np.arange(4), "perseus": actions},
    )
    table.save(TABLE)
    sys.stdout.write(f"{len(vectors)} vectors; {TABLE.stat().st_size / 1000:.0f} kB\n")


def _axis_text(table: Floats) -> str:
    places_m = np.array([[x, 0.0] for x in (1.0, 2.0, 5.0, 10.0, 20.0, 30.0)])
    with_gas = 1.0 - GRID.looked_up(table[:1], places_m)[0]
    return ", ".join(f"{x:g} m {share:.0%}" for (x, _), share in zip(places_m, with_gas, strict=True))


def fly(n_episodes: int) -> None:
    """Print how often and after how many moves the policies find sources in their own model."""
    table = PlumeTable.load(TABLE)
    problem = problem_of(table.level_frac)
    for policy in sorted(table.vectors):
        for escapes in (False, True):
            rng = np.random.default_rng(SEED + 1)
            moves = [_moves(table, problem, policy, rng, escapes=escapes) for _ in range(n_episodes)]
            found = [n for n in moves if n is not None]
            mean, error = np.mean(found), np.std(found) / np.sqrt(len(found))
            sys.stdout.write(
                f"{policy:<8} {'leaves circles' if escapes else 'alone':<15} "
                f"found {len(found) / n_episodes:6.1%} of {n_episodes}, in {mean:.1f} +- {error:.1f} moves\n"
            )


# With `escapes` the fourth visit of a cell is followed by moves straight on at random, as in the agent.
def _moves(table: PlumeTable, problem: Pomdp, policy: str, rng: np.random.Generator, *, escapes: bool) -> int | None:
    belief = first_belief(rng)
    state = int(rng.choice(problem.n_states, p=belief))
    visits: Counter[int] = Counter()
    n_escape = straight = 0
    for n in range(1, MAX_MOVES + 1):
        visits[state] += 1
        if escapes and n_escape == 0 and visits[state] > STUCK_VISITS:
            n_escape, straight = ESCAPE_MOVES, int(rng.integers(problem.n_actions))
            visits.clear()
        best = int(table.actions[policy][int(np.argmax(table.vectors[policy] @ belief))])
        action = straight if n_escape else best
        n_escape = max(0, n_escape - 1)
        state = int(problem.successor[action, state])
        if problem.is_terminal[state]:
            return n
        level = int(rng.choice(len(problem.observed), p=problem.observed[:, state]))
        belief, _ = update_belief(belief, problem, action, level)
    return None


def main() -> None:
    """Train, or fly what was trained."""
    parser = argparse.ArgumentParser(description="Learns the plume table and the policies of agents/qmdp.")
    parser.add_argument("--episodes", type=int, help="fly so many searches with what was trained, and train nothing")
    arguments = parser.parse_args()
    if arguments.episodes:
        fly(arguments.episodes)
    else:
        train()


if __name__ == "__main__":
    main()
