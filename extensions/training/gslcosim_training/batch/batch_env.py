"""Batch environment: many searches at a time as a vector environment of Gymnasium."""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import UsageError
from gslcosim.base.frames import world_from_body_rotation, yaw_from_quaternion
from gslcosim.base.ticks import NS_PER_S, seconds_from_ticks
from gslcosim.scenario.loader import LoadedScenario
from gslcosim_formats.gaussian_plume import FormulaGasSpec
from gslcosim_search.learned.encoding import (
    N_HEADINGS,
    WIND,
    WORLD,
    action_kind,
    find_frame_problem,
    find_shield_problem,
    turn_actions,
)
from gslcosim_search.learned.policy import SCRAMBLE_STEP, scramble_bits
from gslcosim_search.learned.shield import VelocityShield
from gslcosim_search.learned.wind_frame import WIND_FRAME_NAMES
from gslcosim_services.fields.gas_setup import gas_seed
from gslcosim_services.world import vehicle_records
from gslcosim_training import REMEDY
from gslcosim_training.batch import batch_records
from gslcosim_training.batch.batch_records import (
    CRUISE,
    GO_TO,
    HOLD,
    Searches,
    ThreadScratch,
    build_cases_record,
    build_scratch,
    new_touch,
)
from gslcosim_training.batch.case_builder import EXACT, FLYING, prepare_cases
from gslcosim_training.batch.shields import shield_rows
from gslcosim_training.batch.step import fly
from gslcosim_training.batch.wind_frames import BatchWindFrames
from gslcosim_training.rewards import REWARDS, SUCCESS
from gslcosim_training.search_env import build_action_space

BATCHED_ACTIONS = ("velocity", "velocity_3d", "waypoint", "waypoint_3d", "heading")
_N_DRAWN = 2**32
_MOST_SEED = 2**31
# Searches that a thread takes at a time: few enough that all threads end together.
_CHUNK = 256


class BatchActions:
    """Turns actions of one kind into tasks.

    `tasks` (n,) and `vectors` (n, 3) are what each search is to do next, as kernels take them.

    Args:
        action: One of `BATCHED_ACTIONS`.
        shape: Of the actions of all searches.
        step_m: The longest leg [m].
        speed_m_s: The highest speed of velocities [m/s].
    """

    def __init__(self, action: str, shape: tuple[int, ...], *, step_m: float, speed_m_s: float) -> None:
        self._shape = shape
        self._is_heading = action == "heading"
        self._cruises = action.startswith("velocity")
        self._step_m, self._speed_m_s = step_m, speed_m_s
        self.tasks = np.full(shape[0], CRUISE if self._cruises else GO_TO, np.int64)
        self.vectors = np.zeros((shape[0], 3))
        rad = [2 * math.pi * choice / N_HEADINGS for choice in range(N_HEADINGS + 1)]
        self._legs = np.array([[elementary.cos(heading_rad), elementary.sin(heading_rad)] for heading_rad in rad])

    def take(
        self,
        actions: NDArray[Any],
        searches: NDArray[np.void],
        cases: NDArray[np.void],
        *,
        upwind: NDArray[np.float64] | None = None,
        shield: Callable[[NDArray[np.float64]], None] | None = None,
    ) -> None:
        """Take the next actions.

        Args:
            searches: (n,) records of `SEARCH`.
            cases: Records of `CASE`, to which those of the searches point.
            upwind: (n, 2) unit vectors, world frame, where actions are in the wind frame.
            shield: Changes velocities that lead into obstacles, where there is one.

        Raises:
            UsageError: they have another shape, or are not finite, or no choices.
        """
        given = np.asarray(actions)
        if given.shape != self._shape:
            raise UsageError(f"step: actions: expected shape {self._shape}, was {given.shape}.")
        if self._is_heading:
            if not np.isin(given, np.arange(N_HEADINGS + 1)).all():
                raise UsageError(f"step: actions: expected 0 to {N_HEADINGS}, was {given.min()} to {given.max()}.")
            self.tasks[:] = np.where(given == N_HEADINGS, HOLD, GO_TO)
            self._send(self._step_m * self._legs[given.astype(np.int64)], searches, cases)
            return
        given = given.astype(np.float64)
        if not np.isfinite(given).all():
            raise UsageError(f"step: actions: expected finite numbers, was {given[~np.isfinite(given)][0]}.")
        if upwind is not None:
            given = turn_actions(given, upwind)
        if shield is not None:
            shield(given)
        if self._cruises:
            self.vectors[:, : given.shape[1]] = self._speed_m_s * given
        else:
            self._send(self._step_m * given, searches, cases)

    # The next place from where the vehicle is, off the walls.
    def _send(self, offsets_m: NDArray[np.float64], searches: NDArray[np.void], cases: NDArray[np.void]) -> None:
        from_m, n_axes, i_cases = searches["position_m"].copy(), offsets_m.shape[1], searches["case"]
        heights_m = cases["search_height_m"][i_cases]
        if n_axes == 2:
            from_m[:, 2] = heights_m
        from_m[:, :n_axes] += offsets_m
        self.vectors[:] = np.clip(from_m, cases["least_m"][i_cases], cases["most_m"][i_cases])
        if n_axes == 2:
            self.vectors[:, 2] = heights_m


def cumulate_case_fractions(weights: Any, n_cases: int) -> NDArray[np.float64] | None:
    """Return the shares of cases, summed up, (n_cases,); nothing where all come equally often.

    Args:
        weights: One for each case, not negative, not all 0; or None.

    Raises:
        UsageError: the weights are not such numbers.
    """
    if weights is None:
        return None
    given = np.asarray(weights, np.float64)
    if given.shape != (n_cases,) or not np.isfinite(given).all() or given.min() < 0 or not given.sum() > 0:
        raise UsageError(
            f"reset: options: weights: expected {n_cases} numbers from 0, one for each case, not all 0, was "
            f"{weights!r}."
        )
    sums = np.cumsum(given)
    shares = sums / sums[-1]
    # Rounding must not let the last case that comes end below 1.
    shares[np.flatnonzero(given)[-1] :] = 1.0
    return shares


def find_drawn_cases(drawn: NDArray[np.uint64], n_cases: int, shares: NDArray[np.float64] | None) -> NDArray[np.int64]:
    """Return the cases that random whole numbers below 2^32 stand for; see `cumulate_case_fractions`."""
    if shares is None:
        return (drawn % n_cases).astype(np.int64)
    return np.searchsorted(shares, drawn / _N_DRAWN, side="right")


try:
    from gymnasium import spaces
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError as error:  # an extra
    raise UsageError(f"gymnasium: expected the package, found none. Install it with: {REMEDY}") from error


class BatchSearchEnv(VectorEnv[NDArray[np.float32], Any, NDArray[Any]]):
    """Independent searches, each in a case drawn again at its resets, stepped by compiled code in one call.

    Observations, actions, rewards and `infos` are those of `SearchEnv`, whose flights these are: with the same case,
    seed and actions all numbers of point robots are the same, to the bit. A step lasts from each search's question to
    its next, so searches with `mode: on_request` fly on for different times.

    `infos` has arrays: `distance_to_source_m`, `path_length_m`, `n_commands`, `time_s`; and of searches that end
    `outcome`, `success` and `case`, the number of the case that they flew. A search that is over begins again with its
    next step (`AutoresetMode.NEXT_STEP`), whose action is of no account and whose reward is 0, or at once with
    `autoreset_mode="same_step"`.

    Each search draws its cases and seeds from a stream of its own, which follows from the seed of `reset` and the
    search's index alone.

    Args:
        cases: Scenarios with one agent, places drawn; see `LearningTask.loaded`.
        n_envs: How many searches.
        action: As for `SearchEnv`: `velocity`, `velocity_3d`, `waypoint`, `waypoint_3d` or `heading`.
        step_m: The longest leg [m].
        speed_m_s: The highest speed of velocities [m/s].
        hold_s: How long a waypoint is held and a velocity kept [s]; absent: as each scenario says.
        reward: `sparse` or `potential`.
        discount: Of the shaping of `potential`.
        frame: `world`, or `wind`: velocities and waypoints are then upwind and to the left of it.
        has_wind_frame: Whether observations have the numbers of `wind_frame` too.
        shield_m: The distance that velocities keep from what range finders see [m]; absent: no shield.
        autoreset_mode: `next_step` or `same_step`.
        flying: `exact` takes point robots alone; the others take rotorcraft too. With `rigid_body` they have attitude,
            rotors and control of a single flight, and are where it is but for rounding; with `first_order` they fly as
            point masses whose force lags what their control wants, and are near it.
        n_threads: How many threads fly; absent: as many as there are processors. Results do not depend on it.
        report: Receives how many of how many cases are prepared.

    Raises:
        UsageError: a scenario cannot be batched, or an argument is not one of those.
    """

    def __init__(
        self,
        cases: Sequence[LoadedScenario],
        n_envs: int,
        *,
        action: str = "velocity",
        step_m: float = 1.0,
        speed_m_s: float = 1.0,
        hold_s: float | None = None,
        reward: str = "potential",
        discount: float = 0.99,
        frame: str = WORLD,
        has_wind_frame: bool = False,
        shield_m: float | None = None,
        autoreset_mode: str = "next_step",
        flying: str = EXACT,
        n_threads: int | None = None,
        report: Callable[[int, int], None] | None = None,
    ) -> None:
        if n_envs < 1:
            raise UsageError(f"n_envs: expected at least 1, was {n_envs}.")
        if action not in BATCHED_ACTIONS:
            raise UsageError(f"action: expected one of {', '.join(BATCHED_ACTIONS)} in a batch, was {action!r}.")
        if reward not in REWARDS:
            raise UsageError(f"reward: expected one of {', '.join(REWARDS)} in a batch, was {reward!r}.")
        if (problem := find_frame_problem(action, frame)) is not None:
            raise UsageError(f"frame: {problem}")
        if (problem := find_shield_problem(action, shield_m)) is not None:
            raise UsageError(f"shield_m: {problem}")
        if autoreset_mode not in ("next_step", "same_step"):
            raise UsageError(f"autoreset_mode: expected next_step or same_step, was {autoreset_mode!r}.")
        if flying not in FLYING:
            raise UsageError(f"flying: expected one of {', '.join(FLYING)}, was {flying!r}.")
        self._loaded = tuple(cases)
        self._prepared = prepare_cases(self._loaded, hold_s, flying, report, action)
        self._reward, self._discount = reward, discount
        self._resets_at_once = autoreset_mode == "same_step"
        self.metadata = {
            "autoreset_mode": AutoresetMode.SAME_STEP if self._resets_at_once else AutoresetMode.NEXT_STEP,
        }
        self.num_envs = n_envs
        self.observation_names: tuple[str, ...] = self._prepared.names
        self._shield: VelocityShield | None = None
        if shield_m is not None:
            self._shield = VelocityShield(
                self._prepared.briefing, self.observation_names, keep_m=shield_m, speed_m_s=speed_m_s, hold_s=hold_s
            )
        self._is_turned = frame == WIND
        self._frames: BatchWindFrames | None = None
        if has_wind_frame or self._is_turned:
            self._frames = BatchWindFrames(self.observation_names, n_envs, self._prepared.cases.cases)
            self.observation_names += WIND_FRAME_NAMES
        n_numbers = len(self.observation_names)
        kind = action_kind(action, self._prepared.briefing, step_m=step_m, speed_m_s=speed_m_s, hold_s=hold_s)
        self.single_observation_space = spaces.Box(-1.0, 1.0, (n_numbers,), np.float32)
        self.single_action_space = build_action_space(kind)
        self.observation_space = batch_space(self.single_observation_space, n_envs)
        self.action_space = batch_space(self.single_action_space, n_envs)
        self._n_sensors = self._prepared.cases.instruments.shape[1]
        self._searches = Searches(
            searches=np.zeros(n_envs, batch_records.SEARCH),
            paths=np.zeros(n_envs, vehicle_records.STATE),
            gauges=np.zeros((n_envs, self._n_sensors), batch_records.GAUGE),
            memory=np.zeros((n_envs, self._prepared.n_memory)),
            wanders=np.zeros((n_envs, self._prepared.n_wanders), batch_records.WANDER),
        )
        self._observations = np.zeros((n_envs, n_numbers), np.float32)
        self._actions = BatchActions(action, self.action_space.shape or (), step_m=step_m, speed_m_s=speed_m_s)
        self._is_over = np.zeros(n_envs, np.bool_)
        # Lengths of paths when the referee looked last [m].
        self._paths_m = np.zeros(n_envs)
        self._next_cases, self._next_seeds = np.zeros(n_envs, np.int64), np.zeros(n_envs, np.int64)
        self._stream_seed: int | None = None
        # Shares of the cases, summed up; absent: all come equally often.
        self._shares: NDArray[np.float64] | None = None
        self.n_ticks = 0
        n_threads = n_threads or len(os.sched_getaffinity(0))
        n_places = self._prepared.cases.places_m.shape[1]
        self._touch, self._cases = new_touch(n_places), build_cases_record(self._prepared.cases)
        self._work = [
            build_scratch(n_places, self._prepared.most_filaments, vehicle_records.STATE) for _ in range(n_threads)
        ]
        self._threads = ThreadPoolExecutor(n_threads) if n_threads > 1 else None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin all searches again.

        Args:
            seed: Decides what all searches draw from now on; absent: drawn at the first reset, and kept.
            options: `cases` and `seeds`, (n_envs,) each: which case and which scenario's seed each search takes now;
                `weights`, one for each case: how often it comes, now and until the next call; absent: equally often.

        Raises:
            UsageError: there are other options, or they do not fit.
        """
        super().reset(seed=seed)
        if seed is not None or self._stream_seed is None:
            self._stream_seed = int(self.np_random.integers(2**62)) if seed is None else int(seed)
            self._searches.searches["n_begun"] = 0
        rows, options = np.arange(self.num_envs), dict(options or {})
        self._shares = cumulate_case_fractions(options.pop("weights", None), len(self._loaded))
        cases, seeds = self._drawn(rows)
        for name, values in options.items():
            chosen = np.asarray(values, np.int64)
            most = {"cases": len(self._loaded), "seeds": _MOST_SEED}.get(name)
            if most is None or chosen.shape != (self.num_envs,) or chosen.min() < 0 or chosen.max() >= most:
                raise UsageError(
                    f"reset: options: expected cases (0 to {len(self._loaded) - 1}) and seeds (0 to {_MOST_SEED - 1}), "
                    f"{self.num_envs} of each, or weights, was {name} = {values!r}."
                )
            cases, seeds = (chosen, seeds) if name == "cases" else (cases, chosen)
        self._begin(rows, cases, seeds)
        return self._observations.copy(), self._infos()

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Give each search a command and fly on until each asks for the next, or is over; see the class.

        Raises:
            UsageError: the actions have another shape, or are not finite; or there was no reset.
        """
        if self._stream_seed is None:
            raise UsageError("step: expected searches that go on, was none. Call reset first.")
        searches = self._searches.searches
        upwind = self._frames.upwind if self._frames is not None and self._is_turned else None
        shield = None if self._shield is None else shield_rows(self._shield, self._observations)
        self._actions.take(actions, searches, self._prepared.cases.cases, upwind=upwind, shield=shield)
        was_over = self._is_over.copy()
        flying = np.flatnonzero(~was_over)
        ticks = searches["tick"].copy()
        self._fly(flying, batch_records.STEP)
        if self._frames is not None:
            self._frames.advance(flying, searches["case"], self._observations)
        self.n_ticks += int((searches["tick"] - ticks).sum())
        self._is_over = searches["outcome"] != batch_records.SEARCHES_ON
        is_truncated = searches["outcome"] == batch_records.TIME_LIMIT
        rewards = np.where(was_over, 0.0, self._rewards(ticks))
        ended = self._is_over & ~was_over
        terminated, truncated = ended & ~is_truncated, ended & is_truncated
        infos = self._infos(ended)
        again = np.flatnonzero(ended if self._resets_at_once else was_over)
        if self._resets_at_once and len(again):
            infos["final_obs"] = _as_objects(self._observations, ended)
            infos["_final_obs"] = ended
            infos["final_info"] = {key: value for key, value in infos.items() if "final_obs" not in key}
            infos["_final_info"] = ended
        if len(again):
            self._begin(again, *self._drawn(again))
            begun = self._infos()
            infos.update({key: begun[key] for key in begun if not key.startswith("_")})
        return self._observations.copy(), rewards, terminated, truncated, infos

    def loaded(self, i: int) -> LoadedScenario:
        """Return the scenario that search `i` flies now, with its seed: a single flight of it is the same."""
        search = self._searches.searches[i]
        loaded = self._loaded[int(search["case"])]
        update: dict[str, Any] = {"seed": int(search["seed"])}
        if not isinstance(loaded.scenario.gas, FormulaGasSpec):
            # Filaments are those of the case, whatever the noise.
            seed = gas_seed(loaded.scenario, loaded.scenario.seed)
            update["gas"] = loaded.scenario.gas.model_copy(update={"seed": seed})
        return replace(loaded, scenario=loaded.scenario.model_copy(update=update))

    @property
    def body_states(self) -> NDArray[np.float64]:
        """True states of the vehicles now, (n_envs, 13), as `truth/bodies` has them.

        They are position xyz [m] and quaternion wxyz, velocity xyz [m/s], world frame, and rates [rad/s], body frame.
        """
        names = ("position_m", "quaternion_wxyz", "velocity_m_s", "rates_rad_s")
        return np.concatenate([self._searches.searches[name] for name in names], axis=1)

    @property
    def diagonals_m(self) -> NDArray[np.float64]:
        """The diagonals of the cases' rooms [m]."""
        return self._prepared.cases.cases["diagonal_m"].copy()

    @property
    def bytes_per_env(self) -> int:
        """Bytes that each search takes, beside the cases that all share."""
        arrays = (
            *self._searches, self._observations, self._actions.tasks, self._actions.vectors, self._is_over,
            self._next_cases, self._next_seeds, self._paths_m,
        )  # fmt: skip
        n_bytes = sum(array.nbytes for array in arrays) // self.num_envs
        return n_bytes + (0 if self._frames is None else self._frames.bytes_per_env)

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads."""
        del kwargs
        if self._threads is not None:
            self._threads.shutdown()

    def _drawn(self, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        assert self._stream_seed is not None, "reset has drawn it"
        bits = scramble_bits(np.full(len(rows), self._stream_seed, np.uint64))
        for number in (rows, self._searches.searches["n_begun"][rows]):
            bits = scramble_bits(bits + SCRAMBLE_STEP * number.astype(np.uint64))
        cases = find_drawn_cases(bits >> np.uint64(32), len(self._loaded), self._shares)
        return cases, (bits % np.uint64(_MOST_SEED)).astype(np.int64)

    def _begin(self, rows: NDArray[np.int64], cases: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        self._searches.searches["n_begun"][rows] += 1
        self._next_cases[rows], self._next_seeds[rows] = cases, seeds
        self._fly(rows, batch_records.BEGIN)
        if self._frames is not None:
            self._frames.begin(rows)
            self._frames.advance(rows, self._searches.searches["case"], self._observations)
        self._paths_m[rows] = self._lengths_m(rows)
        self._is_over[rows] = self._searches.searches["outcome"][rows] != batch_records.SEARCHES_ON

    def _fly(self, rows: NDArray[np.int64], how: int) -> None:
        parts = [rows[first : first + _CHUNK] for first in range(0, len(rows), _CHUNK)]
        if self._threads is None or len(parts) == 1:
            n_touched = sum(self._fly_part(part, how, self._work[0]) for part in parts)
        else:
            n_threads = len(self._work)

            def some(k: int) -> int:
                return sum(self._fly_part(part, how, self._work[k]) for part in parts[k::n_threads])

            n_touched = sum(self._threads.map(some, range(n_threads)))
        if n_touched:
            for i in rows[self._searches.searches["touched_at"][rows] >= 0].tolist():
                self._finish(i)

    def _fly_part(self, rows: NDArray[np.int64], how: int, work: ThreadScratch) -> int:
        n_touched = fly(
            rows, how, self._next_cases, self._next_seeds, self._actions.tasks, self._actions.vectors, self._touch,
            self._cases, self._searches, work.record, self._observations,
        )  # fmt: skip
        return int(n_touched)

    # A touch is rare, and MuJoCo's.
    def _finish(self, i: int) -> None:
        search, path = self._searches.searches[i], self._searches.paths[i : i + 1]
        while search["touched_at"] >= 0:
            i_case, tick = int(search["case"]), int(search["tick"])
            scene, case = self._prepared.scenes[i_case], self._prepared.cases.cases[i_case]
            begin_s = float(case["warm_up_s"]) + seconds_from_ticks(tick - 1, int(case["tick_ns"]))
            touched = scene.fly(int(search["touched_at"]), tick, float(case["tick_s"]), begin_s, path, search)
            search["position_m"], search["velocity_m_s"] = touched.pose[:3], touched.motion[:3]
            search["quaternion_wxyz"], search["rates_rad_s"] = touched.pose[3:], touched.motion[3:]
            w, x, y, z = touched.pose[3:].tolist()
            yaw_rad = yaw_from_quaternion((w, x, y, z))
            search["yaw_sin"], search["yaw_cos"] = elementary.sin(yaw_rad), elementary.cos(yaw_rad)
            rotation = world_from_body_rotation((w, x, y, z))
            mounts_m = self._prepared.cases.places_m[i_case]
            self._touch.is_touched[0], self._touch.rotation[:] = touched.is_touched, rotation.ravel()
            swings_m_s = _turned_by(touched.motion[3:], mounts_m)
            for k in range(len(mounts_m)):
                self._touch.places_m[k] = search["position_m"] + elementary.product(rotation, mounts_m[k])
                self._touch.velocity_m_s[k] = search["velocity_m_s"] + elementary.product(rotation, swings_m_s[k])
            self._fly_part(np.array([i]), batch_records.FINISH, self._work[0])

    # What the case of each search says.
    def _of_cases(self, name: str) -> NDArray[Any]:
        return self._prepared.cases.cases[name][self._searches.searches["case"]]

    def _times_s(self, ticks: NDArray[np.int64]) -> NDArray[np.float64]:
        return ticks * self._of_cases("tick_ns") / NS_PER_S

    def _lengths_m(self, rows: Any = slice(None)) -> NDArray[np.float64]:
        searches = self._searches.searches[rows]
        # Copied, since a step writes over what it comes from.
        distances_m = searches["scored_distance_m"].copy()
        if self._reward == "sparse":
            return distances_m
        return self._prepared.lengths.lengths_m(searches["case"], searches["scored_place_m"], distances_m)

    # The same sums in the same order as `gslcosim_training.rewards`, for all searches at once.
    def _rewards(self, ticks_before: NDArray[np.int64]) -> NDArray[np.float64]:
        searches = self._searches.searches
        sparse = np.where(searches["outcome"] == batch_records.SUCCESS, SUCCESS, 0.0)
        if self._reward == "sparse":
            return sparse
        diagonals_m = self._of_cases("diagonal_m")
        potential_before = -self._paths_m / diagonals_m
        self._paths_m = self._lengths_m()
        is_cut_off = searches["outcome"] == batch_records.TIME_LIMIT
        goes_on = (searches["outcome"] == batch_records.SEARCHES_ON) | is_cut_off
        potential_after = np.where(goes_on, -self._paths_m / diagonals_m, 0.0)
        taken_s = self._times_s(searches["tick"]) - self._times_s(ticks_before)
        shaping = self._discount * potential_after - potential_before
        return sparse - taken_s / self._of_cases("time_limit_s") + shaping

    def _infos(self, ended: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        searches = self._searches.searches
        infos: dict[str, Any] = {
            "distance_to_source_m": searches["scored_distance_m"].copy(),
            "path_length_m": searches["scored_path_length_m"].copy(),
            "n_commands": searches["scored_n_commands"].copy(),
            "time_s": self._times_s(searches["tick"]),
        }
        everyone = np.ones(self.num_envs, np.bool_)
        infos |= {f"_{key}": everyone for key in list(infos)}
        if ended is not None and ended.any():
            outcomes = np.array(batch_records.OUTCOMES, dtype=object)[searches["outcome"]]
            outcomes[~ended] = None
            infos["outcome"], infos["_outcome"] = outcomes, ended
            infos["success"] = ended & (searches["outcome"] == batch_records.SUCCESS)
            infos["case"] = searches["case"].astype(np.int64)
            infos["_success"] = infos["_case"] = ended
        return infos


# The cross products of a rate of turn (3,) and places (n, 3), as `numpy.cross` has them, of which its checks take most.
def _turned_by(rates: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    p, q, r = rates.tolist()
    x, y, z = places.T
    return np.stack([q * z - r * y, r * x - p * z, p * y - q * x], axis=1)


def _as_objects(observations: NDArray[np.float32], chosen: NDArray[np.bool_]) -> NDArray[np.object_]:
    finals = np.full(len(chosen), None, dtype=object)
    for i in np.flatnonzero(chosen).tolist():
        finals[i] = observations[i].copy()
    return finals
