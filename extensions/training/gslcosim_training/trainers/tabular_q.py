"""Tabular Q-learning over many searches at once, the smallest example of a trainer."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.problems import Problem
from gslcosim.base.rng import stream
from gslcosim_search.learned.policy import ActionSettings
from gslcosim_search.learned.value_table import (
    ChangeFeature,
    LevelFeature,
    SinceFeature,
    StateFeature,
    ValueTable,
    WindPositionFeature,
    nth_best_choices,
)
from gslcosim_training.trainers.search_pool import SearchPool
from gslcosim_training.trainers.trainer import TableSettings, Weights, check_state


def find_action_problems(action: ActionSettings) -> Iterator[Problem]:
    """Yield why a table cannot choose among actions: it needs some to choose from."""
    if not action.n_choices:
        yield Problem(where="action.kind", expected="heading for trainer.kind: table", found=action.kind)


class TabularQ:
    """Learns a `ValueTable`: what each leg is worth in each of a few states.

    Q(s, a) += rate (r + discount V(s') - Q(s, a)), with the mean over all searches that were in s and did a;
    V(s) = (1 - e) max Q(s, .) + e mean Q(s, .), where e is the share of legs that are flown at random: the values are
    those of the table as it is flown.

    Args:
        pool: The cases of training, with `settings.searches` searches.
        action: Of kind `heading`.
        settings: Of the trainer.
        seed: Of the training.
        weights: From mean costs of the cases to how often each comes; costs are shares of failures here.

    Source:
        Watkins and Dayan 1992, Q-learning, Machine Learning 8; the mean over what is flown as in Sutton and Barto
        2018, Reinforcement Learning, section 6.6 (expected Sarsa).
    """

    def __init__(
        self, pool: SearchPool, *, action: ActionSettings, settings: TableSettings, seed: int, weights: Weights
    ) -> None:
        if problem := next(find_action_problems(action), None):
            raise UsageError(str(problem))
        self.pool, self.action, self.settings, self.seed, self.weights = pool, action, settings, seed, weights
        self._digits = _digits_of(settings)
        observed = (name for digit in self._digits for name in digit.observed)
        self.names = tuple(dict.fromkeys((*observed, *settings.wind, settings.refused)))
        self._places = pool.places_of(self.names)
        n_states = int(np.prod([digit.n_classes for digit in self._digits]))
        self._values = np.zeros((n_states, action.n_choices), np.float64)
        self._failures = np.full(pool.n_cases, np.nan)
        self._n_rounds = self._n_steps = 0

    @property
    def is_over(self) -> bool:
        """See `Trainer`."""
        return self._n_rounds >= self.settings.rounds

    def policy(self) -> ValueTable:
        """Return the table as it is now."""
        return ValueTable(
            self.names,
            self.action,
            digits=self._digits,
            values=self._values.astype(np.float32),
            turns_with=self.settings.wind,
            yields_with=self.settings.refused,
            explores=self.settings.explore_last,
        )

    def step(self) -> dict[str, float]:
        """Fly and learn for a round; figures: reward of a leg, share of searches that succeed, explored."""
        s, n = self.settings, self.settings.searches
        rng = stream(self.seed, f"training.round.{self._n_rounds}")
        share = self._n_rounds / max(1, s.rounds - 1)
        explore = s.explore + share * (s.explore_last - s.explore)
        rate = s.rate + share * (s.rate_last - s.rate)
        cases = rng.choice(self.pool.n_cases, size=n, p=self.weights(self._failures))
        envs, table = self.pool.envs, self.policy()
        observed, _ = envs.reset(
            seed=int(rng.integers(2**31)), options={"cases": cases, "seeds": rng.integers(2**31, size=n)}
        )
        memory, is_first = table.memory(n), np.ones(n, np.bool_)
        seen = observed[:, self._places]
        states, memory = table.states(seen, memory)
        begins = np.zeros(n, np.bool_)
        rewarded, successes = 0.0, 0.0
        for _ in range(s.steps_per_round):
            choices = nth_best_choices(self._values[states], memory[:, -1])
            drawn = rng.random(n) < explore
            choices = np.where(drawn, rng.integers(self.action.n_choices, size=n), choices)
            observed, rewards, terminated, truncated, infos = envs.step(table.turned(choices, seen))
            seen = observed[:, self._places]
            ends = np.asarray(terminated) | np.asarray(truncated)
            memory = np.where(begins[:, None], table.memory(n), memory)
            after, memory = table.states(seen, memory)
            goes_on = ~np.asarray(terminated)
            next_values = self._values[after]
            worth = (1.0 - explore) * next_values.max(axis=1) + explore * next_values.mean(axis=1)
            wanted = np.asarray(rewards) + s.discount * goes_on * worth
            # In the step after its end a search begins again, and learns nothing.
            self._learn(states[~begins], choices[~begins], wanted[~begins], rate)
            rewarded += float(np.asarray(rewards)[~begins].sum())
            self._n_steps += int((~begins).sum())
            if ends.any():
                first = ends & is_first
                successes += float(np.asarray(infos["success"])[first].sum())
                self._remember(cases[first], 1.0 - np.asarray(infos["success"])[first].astype(np.float64))
                is_first &= ~ends
            states, begins = after, ends
        self._n_rounds += 1
        return {
            "round": float(self._n_rounds),
            "steps": float(self._n_steps),
            "mean_reward": rewarded / (n * s.steps_per_round),
            # Of the first searches of a round; one that has not ended in it has not succeeded.
            "success": successes / n,
            "explore": explore,
        }

    def state(self) -> dict[str, NDArray[Any]]:
        """See `Trainer`."""
        return {
            "values": self._values.copy(),
            "failures": self._failures.copy(),
            "n_rounds": np.array(self._n_rounds),
            "n_steps": np.array(self._n_steps),
        }

    def resume(self, state: Mapping[str, NDArray[Any]]) -> None:
        """See `Trainer`."""
        check_state(
            state,
            {"values": self._values.shape, "failures": self._failures.shape, "n_rounds": (), "n_steps": ()},
        )
        self._values = np.array(state["values"], np.float64)
        self._failures = np.array(state["failures"], np.float64)
        self._n_rounds, self._n_steps = int(state["n_rounds"]), int(state["n_steps"])

    def _learn(
        self, states: NDArray[np.int64], choices: NDArray[np.int64], wanted: NDArray[np.float64], rate: float
    ) -> None:
        sums, counts = np.zeros_like(self._values), np.zeros_like(self._values)
        np.add.at(sums, (states, choices), wanted)
        np.add.at(counts, (states, choices), 1.0)
        met = counts > 0
        self._values[met] += rate * (sums[met] / counts[met] - self._values[met])

    def _remember(self, cases: NDArray[np.int64], failures: NDArray[np.float64]) -> None:
        for case, failure in zip(cases.tolist(), failures.tolist(), strict=True):
            before = self._failures[case]
            self._failures[case] = failure if np.isnan(before) else 0.5 * (before + failure)


def _digits_of(settings: TableSettings) -> tuple[StateFeature, ...]:
    gas, least = settings.gas, settings.gas_cuts[0] if settings.gas_cuts else 0.0
    of_gas = (
        LevelFeature(observation=gas, cuts=settings.gas_cuts),
        ChangeFeature(observation=gas, cuts=settings.change_cuts),
        SinceFeature(observation=gas, cuts=settings.since_cuts, above=least),
    )
    if not settings.place_cuts:
        return of_gas
    sin, cos = settings.wind
    return (*of_gas, WindPositionFeature(x="x", y="y", sin=sin, cos=cos, cuts=settings.place_cuts))
