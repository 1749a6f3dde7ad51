"""A vector environment of a toy: reach the side from which the wind comes, in a hall of 4 x 4 m, in 30 steps."""

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

NAMES = ("x", "y", "wind.from_sin", "wind.from_cos")
N_STEPS, SIDE_M, STEP_M = 30, 2.0, 0.2


class ToyHall(VectorEnv):
    """Rewards progress upwind, and 1 at the wall; `hides_wind` shows the wind in the first observation only."""

    def __init__(self, num_envs, *, resets="same", choices=False, hides_wind=False):
        self.num_envs = num_envs
        mode = AutoresetMode.SAME_STEP if resets == "same" else AutoresetMode.NEXT_STEP
        self.metadata = {"autoreset_mode": mode}
        self.resets_at_once, self.choices, self.hides_wind = resets == "same", choices, hides_wind
        self.rng = np.random.default_rng(0)
        self.place_m, self.upwind = np.zeros((num_envs, 2)), np.zeros((num_envs, 2))
        self.n_done, self.ended = np.zeros(num_envs, int), np.zeros(num_envs, bool)

    def reset(self, *, seed=None, options=None):
        self.rng = np.random.default_rng(seed)
        self.ended[:] = False
        self.begin(np.ones(self.num_envs, bool))
        return self.seen(), {}

    def begin(self, which):
        n = int(which.sum())
        self.place_m[which] = self.rng.uniform(-0.5, 0.5, (n, 2))
        angle_rad = self.rng.integers(4, size=n) * np.pi / 2
        self.upwind[which] = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1)
        self.n_done[which] = 0

    def seen(self):
        wind = self.upwind[:, ::-1] * ((self.n_done == 0) | (not self.hides_wind))[:, None]
        return np.concatenate([self.place_m / SIDE_M, wind], axis=1).astype(np.float32)

    def step(self, actions):
        was_over = self.ended.copy()
        if self.choices:
            angle_rad = 2 * np.pi * np.asarray(actions) / 8
            moves = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1) * (np.asarray(actions) < 8)[:, None]
        else:
            moves = np.asarray(actions)
        moves = np.where(was_over[:, None], 0.0, moves)
        gained = STEP_M * (moves * self.upwind).sum(axis=1)
        self.place_m = np.clip(self.place_m + STEP_M * moves, -SIDE_M, SIDE_M)
        self.n_done += 1
        success = ((self.place_m * self.upwind).sum(axis=1) >= SIDE_M - 1e-9) & ~was_over
        truncated = (self.n_done >= N_STEPS) & ~success & ~was_over
        rewards = np.where(was_over, 0.0, success + gained / SIDE_M - 1.0 / N_STEPS)
        over = success | truncated
        finals = self.seen()
        if self.resets_at_once:
            self.begin(over)
        else:
            self.begin(was_over)
            self.ended = over
        infos = {"success": success.copy()}
        if self.resets_at_once:
            infos["final_obs"] = np.array([*finals, None], dtype=object)[:-1]
        return self.seen(), rewards, success, truncated, infos
