"""Toy plumes, searches in them, and what these learn: compiled loops of `train_q_memory.py`, which tells what they are.

Random numbers come from a numpy generator that is handed in.
"""
# pyright: basic

from gslcosim.base.kernel_cache import use_kernel_cache

use_kernel_cache()

import numba  # noqa: E402
import numpy as np  # noqa: E402

from gslcosim_search.reactive import temporal_memory  # noqa: E402
from gslcosim_search.reactive.temporal_memory import N_MOVES, N_STATES  # noqa: E402

# Films: (frames, x, y), 0.1 s and 0.1 m apart; the source is at SOURCE_M.
CELL_M, FRAME_S, N_FRAMES = 0.1, 0.1, 1200
LENGTH_M, WIDTH_M = 12.0, 8.0
SOURCE_M = (1.5, 4.0)
STEP_M, READS_A_STEP = 0.5, 12
FOUND_M, NOISE = 0.75, 0.1
LEAST_S, MOST_S, FIRST_S = 1.0, 30.0, 5.0
MOST_STEPS, MOST_HISTORY = 500, 3000
REWARD_STEP, DISCOUNT, FIRST_VALUE = -0.001, 0.995, 0.6
# Steps along x (the wind blows that way) and y, for up, down, left and right of the wind, looking up it.
MOVES = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
CIRCLE = np.array([0, 2, 1, 3])

memory_features = numba.njit(temporal_memory.memory_features)
rank_frac = numba.njit(temporal_memory.rank_frac)
gas_state = numba.njit(temporal_memory.gas_state)
void_state = numba.njit(temporal_memory.void_state)


@numba.njit(cache=True)
def film_of(wind_m_s, swing_m_s, spread_m_s, puffs_per_s, rng):
    """Return a film of a plume, (frames, x, y) [ppm]: puffs in the plane, in a wind that swings."""
    nx, ny = int(LENGTH_M / CELL_M), int(WIDTH_M / CELL_M)
    film = np.zeros((N_FRAMES, nx, ny), np.float32)
    n_most = int(3.0 * puffs_per_s * LENGTH_M / wind_m_s) + 100
    x, y, v, age = np.zeros(n_most), np.zeros(n_most), np.zeros(n_most), np.full(n_most, -1.0)
    across_m_s, due, oldest = 0.0, 0.0, 0
    n_warm = int(1.5 * LENGTH_M / wind_m_s / FRAME_S)
    for frame in range(-n_warm, N_FRAMES):
        # Ornstein and Uhlenbeck: correlation times of 4 s for the common swing and 1 s for a puff's own.
        across_m_s += -across_m_s * FRAME_S / 4.0 + swing_m_s * np.sqrt(2.0 * FRAME_S / 4.0) * rng.normal()
        due += puffs_per_s * FRAME_S
        while due >= 1.0:
            due -= 1.0
            x[oldest], y[oldest], v[oldest], age[oldest] = SOURCE_M[0], SOURCE_M[1], 0.0, 0.0
            oldest = (oldest + 1) % n_most
        for k in range(n_most):
            if age[k] < 0.0:
                continue
            v[k] += -v[k] * FRAME_S + spread_m_s * np.sqrt(2.0 * FRAME_S) * rng.normal()
            x[k] += wind_m_s * FRAME_S
            y[k] += (across_m_s + v[k]) * FRAME_S
            age[k] += FRAME_S
            if x[k] > LENGTH_M + 1.0:
                age[k] = -1.0
            elif frame >= 0:
                _add_puff(film[frame], x[k], y[k], 0.01 + 0.004 * age[k])
    return film


@numba.njit(cache=True)
def _add_puff(frame, x_m, y_m, variance_m2):
    reach_m = 3.0 * np.sqrt(variance_m2)
    peak = 10.0 * 0.01 / variance_m2
    for i in range(max(0, int((x_m - reach_m) / CELL_M)), min(frame.shape[0], int((x_m + reach_m) / CELL_M) + 1)):
        for j in range(max(0, int((y_m - reach_m) / CELL_M)), min(frame.shape[1], int((y_m + reach_m) / CELL_M) + 1)):
            dx, dy = (i + 0.5) * CELL_M - x_m, (j + 0.5) * CELL_M - y_m
            frame[i, j] += peak * np.exp(-0.5 * (dx * dx + dy * dy) / variance_m2)


@numba.njit(cache=True)
def amount_at(film, frame, x_m, y_m):
    """Return the gas at a place and frame [ppm]; the film begins again at its end."""
    i, j = int(x_m / CELL_M), int(y_m / CELL_M)
    return film[frame % film.shape[0], min(i, film.shape[1] - 1), min(j, film.shape[2] - 1)]


@numba.njit(cache=True)
def recovery_move(recovery, n_void, path, n_path, turn, side, rng):
    """Return the move of a recovery at the `n_void`-th decision in the void, as in `gslcosim_search.reactive`."""
    if recovery == 0:
        undone = n_void - 1
        if undone < n_path:
            move = path[n_path - 1 - undone]
            return move + 1 if move % 2 == 0 else move - 1
        return rng.integers(0, 4)
    if recovery == 1:
        run, left = 1, n_void
        while left > run:
            left -= run
            run += 1
        return CIRCLE[(turn + side * (run - 1)) % 4]
    run, left, across = 1, n_void, side
    while left > run:
        left -= run
        if left == 1:
            return 0
        left -= 1
        run *= 2
        across = -across
    return 2 if across > 0 else 3


@numba.njit(cache=True)
def episode(film, start, table, recovery, memory_s, rate, explore, rng):
    """Fly one search, learning on the way; return its steps, negative where it did not find the source.

    `start` is (frame, x, y); `table` (states, moves) is changed in place where the learning `rate` is above 0.
    """
    buffer, stamps = np.zeros(400), 0
    history, n_history = np.zeros(MOST_HISTORY), 0
    path, n_path = np.zeros(MOST_STEPS + 1, np.int64), 0
    frame, x_m, y_m = int(start[0]), start[1], start[2]
    adapts = memory_s == 0.0
    remembered_s = FIRST_S if adapts else memory_s
    last_hit, n_void, turn, side = -1, 0, 0, 1
    last_state, last_move, gained, discount = -1, 0, 0.0, 1.0
    move, has_arrived = -1, False
    for step in range(MOST_STEPS):
        has_hit = False
        for _ in range(READS_A_STEP):
            if move >= 0:
                x_m = min(max(x_m + MOVES[move, 0] * STEP_M / READS_A_STEP, 0.0), LENGTH_M - 1e-6)
                y_m = min(max(y_m + MOVES[move, 1] * STEP_M / READS_A_STEP, 0.0), WIDTH_M - 1e-6)
            frame += 1
            amount = amount_at(film, frame, x_m, y_m)
            buffer[stamps % buffer.size] = amount
            stamps += 1
            if amount > NOISE:
                if last_hit >= 0 and stamps - last_hit > 1 and adapts:
                    remembered_s = min(max((stamps - last_hit) * FRAME_S, LEAST_S), MOST_S)
                last_hit, has_hit = stamps, True
                history[n_history % MOST_HISTORY] = amount
                n_history += 1
            if (x_m - SOURCE_M[0]) ** 2 + (y_m - SOURCE_M[1]) ** 2 < FOUND_M**2:
                has_arrived = True
        n = min(stamps, round(remembered_s / FRAME_S))
        recent = np.empty(n)
        for k in range(n):
            recent[k] = buffer[(stamps - n + k) % buffer.size]
        share, mean = memory_features(recent, n, NOISE)
        if share > 0.0:
            state = gas_state(share, rank_frac(mean, history, min(n_history, MOST_HISTORY)))
            n_void = 0
        else:
            n_void += 1
            state = void_state(n_void)
            if n_void == 1:
                turn, side = rng.integers(0, 4), 2 * rng.integers(0, 2) - 1
        is_choice = share > 0.0 or recovery == 3
        if move >= 0:
            gained += discount * (1.0 if has_arrived else REWARD_STEP)
            discount *= DISCOUNT
        if rate > 0.0 and last_state >= 0 and (is_choice or has_arrived):
            future = 0.0 if has_arrived else discount * table[state].max()
            table[last_state, last_move] += rate * (gained + future - table[last_state, last_move])
        if has_arrived:
            return step
        if has_hit:
            n_path = 0
        if is_choice:
            move = rng.integers(0, 4) if rng.random() < explore else np.argmax(table[state])
            last_state, last_move, gained, discount = state, move, 0.0, 1.0
        else:
            move = recovery_move(recovery, n_void, path, n_path, turn, side, rng)
        if share > 0.0:
            path[n_path] = move
            n_path += 1
    return -MOST_STEPS


@numba.njit(cache=True)
def learn(films, starts, recovery, memory_s, n_episodes, rng):
    """Return the table that so many episodes teach."""
    table = np.full((N_STATES, N_MOVES), FIRST_VALUE)
    for k in range(n_episodes):
        i, j = rng.integers(0, films.shape[0]), rng.integers(0, starts.shape[1])
        rate, explore = 0.25 * np.exp(-3.0 * k / n_episodes), 0.99 * np.exp(-6.0 * k / n_episodes)
        episode(films[i], starts[i, j], table, recovery, memory_s, rate, explore, rng)
    return table


@numba.njit(cache=True)
def fly(films, starts, table, recovery, memory_s, rng):
    """Return the steps of a search from each start in each film, negative where it did not find the source."""
    steps = np.zeros((films.shape[0], starts.shape[1]), np.int64)
    for i in range(films.shape[0]):
        for j in range(starts.shape[1]):
            steps[i, j] = episode(films[i], starts[i, j], table, recovery, memory_s, 0.0, 0.0, rng)
    return steps
