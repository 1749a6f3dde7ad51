"""Learns what `agents/q_memory` knows: which way to step, up, down or across the wind, by what its memory holds.

Run with `python docs/studies/train_q_memory.py` (minutes on one core; `--episodes` says how many): it rewrites
`agents/q_memory/policies.json` and prints how the policies do in plumes that they were not trained in. With `--test` it
only prints that table for the file as it is.

The plumes are toys: films of puffs in the plane that a steady wind carries, that a common wind across swings, and that
spread and grow on their own. Winds of 0.4 to 1 m/s, more and less swing, dense and sparse releases; all seeds are
fixed. A searcher begins somewhere in the mean plume at a moment with gas, steps 0.5 m in 1.2 s and reads ten times a
second; 0.75 m from the source it has found it. What it knows of the gas is what
`gslcosim_search.reactive.temporal_memory` says. Tabular Q-learning as in Rando et al. 2025: Q begins at 0.6,
reward 1 at the source less 0.001 a step, discount
0.995 (theirs is 0.9999, with which steps weigh less than chance), learning rate 0.25 e^(-3 k/n) and exploration
0.99 e^(-6 k/n) at episode k of n.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from q_memory_kernels import CELL_M, FOUND_M, NOISE, SOURCE_M, STEP_M, film_of, fly, learn

from gslcosim_search.reactive.temporal_memory import N_GAS_STATES, N_MOVES, N_STATES, load_policies

Films = NDArray[np.float32]

POLICIES = Path(__file__).parents[2] / "agents" / "q_memory" / "policies.json"
RECOVERIES = ("backtrack", "circling", "cast_surge", "learned")
MEMORIES_S = (1.0, 3.0, 10.0, 0.0)  # 0 adapts
EPISODES = 100_000
SEED, TEST_SEED = 20_250_101, 77_000_000
# Wind [m/s], swing [m/s], spread [m/s], puffs a second.
PLUMES = ((0.4, 0.10, 0.04, 10.0), (0.7, 0.15, 0.05, 8.0), (1.0, 0.25, 0.08, 10.0), (0.7, 0.25, 0.05, 2.0))


def films_of(seed: int) -> Films:
    """Return one film of each plume, (n, frames, x, y) [ppm]."""
    return np.stack([film_of(*plume, np.random.default_rng(seed + i)) for i, plume in enumerate(PLUMES)])


def starts_in(films: Films, n: int, seed: int) -> NDArray[np.float64]:
    """Return (films, n, 3) frames and places [m] with gas, at least 1.5 m from the source."""
    rng = np.random.default_rng(seed)
    return np.stack([_starts_in_film(film, n, rng) for film in films])


def _starts_in_film(film: NDArray[np.float32], n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    frames = rng.integers(0, film.shape[0], 4 * n)
    chosen = []
    for frame in frames:
        cells = np.argwhere(film[frame] > NOISE)
        i, j = cells[rng.integers(len(cells))]
        x_m, y_m = (i + 0.5) * CELL_M, (j + 0.5) * CELL_M
        if np.hypot(x_m - SOURCE_M[0], y_m - SOURCE_M[1]) > 1.5:
            chosen.append((frame - 1, x_m, y_m))
    return np.array(chosen[:n], dtype=np.float64)


def test_rows(tables: dict[str, NDArray[np.float64]], n_starts: int) -> list[str]:
    """Return how policies do in films of other seeds: share found, and straight way over flown way of those."""
    films = films_of(TEST_SEED)
    starts = starts_in(films, n_starts, TEST_SEED)
    straight = (np.hypot(starts[..., 1] - SOURCE_M[0], starts[..., 2] - SOURCE_M[1]) - FOUND_M) / STEP_M
    rows = ["recovery     memory   found  straight/flown   found by plume"]
    for name, table in tables.items():
        for memory_s in MEMORIES_S:
            steps = fly(films, starts, table, RECOVERIES.index(name), memory_s, np.random.default_rng(TEST_SEED))
            found = steps > 0
            ratio = np.minimum(1.0, straight[found] / steps[found])
            by_plume = "  ".join(f"{share:6.1%}" for share in found.mean(axis=1))
            memory = f"{memory_s:g} s" if memory_s else "adapts"
            rows.append(f"{name:12} {memory:6}  {found.mean():6.1%}  {ratio.mean():14.2f}   {by_plume}")
    return rows


def written(tables: dict[str, NDArray[np.float64]], n_episodes: int) -> str:
    """Return the file: values of up, down, left and right for each state; of the void only where it was learned."""
    rounded = {
        name: [
            [round(float(value), 4) for value in row] for row in table[: None if name == "learned" else N_GAS_STATES]
        ]
        for name, table in tables.items()
    }
    head = {"made_by": "docs/studies/train_q_memory.py", "seed": SEED, "episodes": n_episodes, "step_m": STEP_M}
    lines = [f'  {json.dumps(name)}: [\n    ' + ",\n    ".join(json.dumps(row) for row in table) + "\n  ]"
             for name, table in rounded.items()]  # fmt: skip
    return json.dumps(head)[:-1] + ', "tables": {\n' + ",\n".join(lines) + "\n}}\n"


def main() -> None:
    """Train and write, or only test."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=EPISODES)
    parser.add_argument("--starts", type=int, default=250, help="test flights a plume")
    parser.add_argument("--test", action="store_true", help="only test the file as it is")
    arguments = parser.parse_args()
    if not arguments.test:
        films = films_of(SEED)
        starts = starts_in(films, 2000, SEED)
        trained = {
            name: learn(films, starts, i, 0.0, arguments.episodes, np.random.default_rng(SEED + i))
            for i, name in enumerate(RECOVERIES)
        }
        POLICIES.write_text(written(trained, arguments.episodes), encoding="utf-8")
    loaded = load_policies(POLICIES)
    tables = {name: np.array(table + [[0.0] * N_MOVES] * (N_STATES - len(table))) for name, table in loaded.items()}
    sys.stdout.write("\n".join(test_rows(tables, arguments.starts)) + "\n")


if __name__ == "__main__":
    main()
