"""Recurrent proximal policy optimisation in JAX: network, loss, updates, and the trainer that uses them.

One thread and float32: the same numbers come out each time on one machine.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.problems import Problem
from gslcosim_search.learned.policy import ActionSettings
from gslcosim_search.learned.recurrent_networks import GruPolicy
from gslcosim_training.trainers.trainer import Curriculum

Arrays = dict[str, Any]
_ONE_THREAD = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
# Of an array that begins as small as if it were not there: then every action is as likely as its opposite.
_SMALL = 0.01
# The observation that says that the last command was refused or changed.
REFUSED = "refused"
# The outcome of a search that has ended by a collision.
COLLISION = "collision"
_OF_VALUES = ("value", "value_bias", "log_spread")
# Settings by what they allow: whole numbers from 1, numbers above 0 and up to 1, numbers from 0.
_WHOLE_SETTINGS = ("rounds", "horizon", "segments", "epochs", "parts", "n_encoded", "n_units")
_SHARE_SETTINGS = ("learning_rate", "discount", "trace", "clip")
_COST_SETTINGS = (
    "entropy_weight", "value_weight", "max_gradient", "refused_cost", "collision_cost", "flown_spread",
)  # fmt: skip


def load_jax() -> tuple[Any, Any]:
    """Return JAX and optax."""
    # Read when JAX is imported first.
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {_ONE_THREAD}".strip()
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    try:
        import jax
        import optax
    except ImportError as error:
        raise UsageError(
            f"trainer: recurrent_ppo needs {error.name}, which is not installed. Install it: "
            "pip install 'gslcosim-training[train]'"
        ) from error
    return jax, optax


@dataclass(frozen=True, kw_only=True)
class Segments:
    """Segments of n agents over t steps: time first, agents second; `observed` and `starts` have t + 1 rows.

    `starts` says where a search begins, before which there is no memory; `chosen` are numbers before tanh, or choices;
    `weights` is 0 where a step was none.
    """

    observed: NDArray[np.float32]
    starts: NDArray[np.bool_]
    memory: NDArray[np.float32]
    chosen: NDArray[Any]
    log_likely: NDArray[np.float32]
    rewards: NDArray[np.float32]
    ends: NDArray[np.bool_]
    weights: NDArray[np.float32]


def initial_arrays(rng: np.random.Generator, *, k: int, m: int, h: int, o: int, is_continuous: bool) -> Arrays:
    """Return the arrays of a network that has learned nothing: those of `GruPolicy`, and of value and spread.

    Orthogonal, as is usual for PPO (Andrychowicz et al. 2021, arXiv 2006.05990, has actions begin small).
    """
    arrays = {
        "encoder": _orthogonal(rng, m, k),
        "encoder_bias": np.zeros(m, np.float32),
        "gates": np.concatenate([_orthogonal(rng, h, m) for _ in range(3)]),
        "gates_bias": np.zeros(3 * h, np.float32),
        "recurrent_gates": np.concatenate([_orthogonal(rng, h, h) for _ in range(3)]),
        "recurrent_bias": np.zeros(3 * h, np.float32),
        "outputs": np.float32(_SMALL) * _orthogonal(rng, o, h),
        "output_bias": np.zeros(o, np.float32),
        "value": _orthogonal(rng, 1, h)[0],
        "value_bias": np.zeros((), np.float32),
    }
    if is_continuous:
        arrays["log_spread"] = np.full(o, -0.5, np.float32)
    return arrays


def _orthogonal(rng: np.random.Generator, rows: int, columns: int) -> NDArray[np.float32]:
    drawn = rng.normal(size=(max(rows, columns), min(rows, columns)))
    q, r = np.linalg.qr(drawn)
    q = q * np.sign(np.diag(r))
    return (q if rows >= columns else q.T).astype(np.float32)


def forward(jax: Any, arrays: Arrays, observed: Any, starts: Any, memory: Any) -> tuple[Any, Any]:
    """Return outputs (t, n, o) and values (t, n) upon observations (t, n, k): the equations of `GruPolicy`."""
    jnp = jax.numpy
    h = memory.shape[1]
    fed = jnp.tanh(observed @ arrays["encoder"].T + arrays["encoder_bias"]) @ arrays["gates"].T + arrays["gates_bias"]

    def step(before: Any, one: Any) -> tuple[Any, Any]:
        fed_now, is_start = one
        before = jnp.where(is_start[:, None], 0.0, before)
        recurrent = before @ arrays["recurrent_gates"].T + arrays["recurrent_bias"]
        both = jax.nn.sigmoid(fed_now[:, : 2 * h] + recurrent[:, : 2 * h])
        reset, kept = both[:, :h], both[:, h:]
        new = jnp.tanh(fed_now[:, 2 * h :] + reset * recurrent[:, 2 * h :])
        after = (1 - kept) * new + kept * before
        return after, after

    _, after = jax.lax.scan(step, memory, (fed, starts))
    return after @ arrays["outputs"].T + arrays["output_bias"], after @ arrays["value"] + arrays["value_bias"]


def log_likelihood(jax: Any, arrays: Arrays, outputs: Any, chosen: Any) -> tuple[Any, Any]:
    """Return the logarithm of how likely the chosen actions are, and the entropy of the choice, (t, n) both."""
    jnp = jax.numpy
    if "log_spread" not in arrays:
        logs = jax.nn.log_softmax(outputs)
        likely = jnp.take_along_axis(logs, chosen[..., None], axis=-1)[..., 0]
        return likely, -(jnp.exp(logs) * logs).sum(-1)
    spread = arrays["log_spread"]
    z = (chosen - outputs) * jnp.exp(-spread)
    likely = (-0.5 * z**2 - spread - 0.5 * jnp.log(2 * jnp.pi)).sum(-1)
    entropy = (spread + 0.5 * jnp.log(2 * jnp.pi * jnp.e)).sum()
    return likely, jnp.full(likely.shape, entropy)


def advantages(rewards: Any, values: Any, ends: Any, *, discount: float, trace: float) -> Any:
    """Return the generalised advantages, (t, n), in numpy.

    d_t = r_t + g V_{t+1} (1 - end_t) - V_t,  A_t = d_t + g l (1 - end_t) A_{t+1}

    Source:
        Schulman et al. 2016, High-dimensional continuous control using generalized advantage estimation,
        arXiv 1506.02438, eq. 16.
    """
    found, after = np.zeros_like(rewards), np.zeros_like(rewards[0])
    goes_on = 1.0 - ends.astype(np.float32)
    for t in reversed(range(len(rewards))):
        change = rewards[t] + discount * values[t + 1] * goes_on[t] - values[t]
        after = found[t] = change + discount * trace * goes_on[t] * after
    return found


# Compiled once for each kind of training in a process.
@lru_cache(maxsize=8)
def build_update(
    settings: Any, n_updates: int
) -> tuple[Callable[[Arrays], Any], Callable[..., Any], Callable[..., Any]]:
    """Return compiled functions: the optimiser's first state, values of segments, and one update.

    The loss is that of PPO with clipped ratios (Schulman et al. 2017, arXiv 1707.06347, eq. 7 and 9); the rate of
    learning falls linearly to a tenth at `n_updates`.
    """
    jax, optax = load_jax()
    jnp = jax.numpy
    rate = optax.linear_schedule(settings.learning_rate, settings.learning_rate / 10, n_updates)
    optimiser = optax.chain(optax.clip_by_global_norm(settings.max_gradient), optax.adam(rate, eps=1e-5))

    def loss(arrays: Arrays, part: Arrays) -> tuple[Any, Any]:
        outputs, values = forward(jax, arrays, part["observed"], part["starts"], part["memory"])
        likely, entropy = log_likelihood(jax, arrays, outputs, part["chosen"])
        weights = part["weights"]
        n = jnp.maximum(weights.sum(), 1.0)
        ratio = jnp.exp(likely - part["log_likely"])
        clipped = jnp.clip(ratio, 1 - settings.clip, 1 + settings.clip)
        gain = part["advantages"]
        of_policy = -(weights * jnp.minimum(ratio * gain, clipped * gain)).sum() / n
        of_value = 0.5 * (weights * (values - part["returns"]) ** 2).sum() / n
        of_entropy = (weights * entropy).sum() / n
        apart = (weights * (ratio - 1 - jnp.log(ratio))).sum() / n
        total = of_policy + settings.value_weight * of_value - settings.entropy_weight * of_entropy
        return total, {"policy_loss": of_policy, "value_loss": of_value, "entropy": of_entropy, "divergence": apart}

    @jax.jit
    def update(arrays: Arrays, state: Any, part: Arrays) -> tuple[Arrays, Any, Any]:
        (_, figures), slopes = jax.value_and_grad(loss, has_aux=True)(arrays, part)
        changes, state = optimiser.update(slopes, state, arrays)
        return optax.apply_updates(arrays, changes), state, figures

    @jax.jit
    def values_of(arrays: Arrays, observed: Any, starts: Any, memory: Any) -> Any:
        return forward(jax, arrays, observed, starts, memory)[1]

    return optimiser.init, values_of, update


@dataclass(frozen=True, kw_only=True)
class PpoSettings:
    """The settings of recurrent PPO.

    `rounds` is how many steps of the trainer make the whole training; a round flies `segments` times `horizon` steps in
    each environment and learns after each segment, `epochs` times from `parts` parts of the environments.
    `n_encoded` and `n_units` are the sizes of the network. `observations` are those that the policy gets, all where
    it is absent. `refused_cost` is taken from the reward where a command was refused: an agent that is asked again at
    once, in front of a wall for example, loses hardly any time by it, and learns slowly to leave. `collision_cost` is
    taken from it where a search ends by a collision: with 0, an agent that finds nothing saves the rest of its time by
    one. `flown_spread` is which share of the spread of training the policy is flown with.
    """

    rounds: int = 100
    horizon: int = 64
    segments: int = 8
    epochs: int = 3
    parts: int = 4
    n_encoded: int = 48
    n_units: int = 48
    learning_rate: float = 7e-4
    discount: float = 0.99
    trace: float = 0.95
    clip: float = 0.2
    entropy_weight: float = 0.01
    value_weight: float = 0.5
    max_gradient: float = 0.5
    refused_cost: float = 0.01
    collision_cost: float = 0.0
    flown_spread: float = 1.0
    observations: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if problem := next(self.find_problems(vars(self)), None):
            raise UsageError(f"recurrent_ppo{problem}")

    @classmethod
    def find_problems(cls, values: Mapping[str, Any]) -> Iterator[Problem]:
        """Yield what is wrong with settings as plain values; places begin with a dot, or are empty."""
        known = [item.name for item in fields(cls)]
        if unknown := sorted(set(values).difference(known)):
            yield Problem(where="", expected=f"settings among {', '.join(known)}", found=", ".join(unknown))
        for name in _WHOLE_SETTINGS:
            value = values.get(name, getattr(cls, name))
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                yield Problem(where=f".{name}", expected="a whole number from 1", found=f"{value!r}")
        for name in _SHARE_SETTINGS:
            value = values.get(name, getattr(cls, name))
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= 1.0:
                yield Problem(where=f".{name}", expected="a number above 0 and up to 1", found=f"{value!r}")
        for name in _COST_SETTINGS:
            value = values.get(name, getattr(cls, name))
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < float("inf"):
                yield Problem(where=f".{name}", expected="a number from 0", found=f"{value!r}")

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "PpoSettings":
        """Return settings from plain values."""
        if problem := next(cls.find_problems(values), None):
            raise UsageError(f"recurrent_ppo{problem}" if problem.where else f"recurrent_ppo: {problem}")
        given = dict(values)
        if (names := given.get("observations")) is not None:
            given["observations"] = tuple(map(str, names))
        return cls(**given)


class RecurrentPpo:
    """Trains a `GruPolicy` in any vector environment of Gymnasium; extra `train`.

    A round begins with new searches, whose seed is that of the training and the round: nothing but what `state` tells
    goes from one round into the next, and a training that was interrupted ends with the same bits.

    Args:
        envs: A `gymnasium.vector.VectorEnv` that starts searches again by itself, in the next step or in the same.
        observation_names: Of the numbers that `envs` tells.
        action: What the actions mean.
        settings: Of the trainer.
        seed: Of the training.
        doping: What the cases have cost, where hard ones are to come more often: a round draws its cases by what those
            before it have cost. Absent: all come equally often.
    """

    def __init__(
        self,
        envs: Any,
        *,
        observation_names: tuple[str, ...],
        action: ActionSettings,
        settings: PpoSettings,
        seed: int,
        doping: Curriculum | None = None,
    ) -> None:
        load_jax()
        self._doping = doping
        self.envs, self.action, self.settings, self.seed = envs, action, settings, seed
        self.n_envs = int(envs.num_envs)
        if self.n_envs % settings.parts:
            raise UsageError(
                f"recurrent_ppo.parts: expected a divisor of {self.n_envs} environments, was {settings.parts}."
            )
        names = observation_names if settings.observations is None else settings.observations
        if strange := [name for name in names if name not in observation_names]:
            raise UsageError(
                f"recurrent_ppo.observations: expected names among {', '.join(observation_names)}, was "
                f"{', '.join(strange)}."
            )
        self.observation_names = tuple(names)
        self._places = np.array([observation_names.index(name) for name in names])
        self._refused = observation_names.index(REFUSED) if REFUSED in observation_names else None
        self._resets_at_once = "same" in str(envs.metadata.get("autoreset_mode", "")).lower()
        n_updates = settings.rounds * settings.segments * settings.epochs * settings.parts
        begin, self._values_of, self._update = build_update(settings, n_updates)
        self._arrays: dict[str, Any] = initial_arrays(
            np.random.default_rng([seed, 0]), k=len(names), m=settings.n_encoded, h=settings.n_units,
            o=action.n_outputs, is_continuous=not action.n_choices,
        )  # fmt: skip
        self._optimiser: Any = begin(self._arrays)
        self.n_rounds = 0

    @property
    def is_over(self) -> bool:
        """True if all rounds are done."""
        return self.n_rounds >= self.settings.rounds

    def policy(self) -> GruPolicy:
        """Return the policy as it is now, with the share of its spread that is flown; of choices the most likely."""
        spread = 0.0
        if "log_spread" in self._arrays:
            spread = self.settings.flown_spread * float(np.exp(np.mean(np.array(self._arrays["log_spread"]))))
        arrays = {name: np.array(array) for name, array in self._arrays.items() if name not in _OF_VALUES}
        return GruPolicy.of_arrays(self.observation_names, self.action, arrays, {"spread": spread})

    def step(self) -> dict[str, float]:
        """Fly and learn for a round, and return its figures: losses, reward and success of the searches.

        A search that has begun with the round and is not over at its end counts as one without success.
        """
        self.n_rounds += 1
        rng = np.random.default_rng([self.seed, self.n_rounds])
        options = {} if self._doping is None else {"options": {"weights": self._doping.shares}}
        observed, _ = self.envs.reset(seed=int(rng.integers(2**31)), **options)
        flight = _Flight(
            observed=np.asarray(observed)[:, self._places],
            memory=self.policy().memory(self.n_envs),
            starts=np.ones(self.n_envs, np.bool_),
        )
        figures: list[Mapping[str, Any]] = []
        for _ in range(self.settings.segments):
            figures += self._learn(self._fly(flight, rng), rng)
        n_steps = self.n_envs * self.settings.horizon * self.settings.segments
        means = {name: float(np.mean([one[name] for one in figures])) for name in figures[0]}
        return {
            "round": float(self.n_rounds), "steps": float(self.n_rounds * n_steps), "searches": float(len(flight.sums)),
            "reward": float(np.mean(flight.sums)) if flight.sums else float("nan"),
            "success": flight.success, **means,
        }  # fmt: skip

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all that the next rounds depend on, as arrays by name."""
        jax, _ = load_jax()
        leaves = jax.tree_util.tree_leaves(self._optimiser)
        return {
            "n_rounds": np.array(self.n_rounds),
            **({} if self._doping is None else {"case_costs": self._doping.costs.copy()}),
            **{f"network.{name}": np.array(array) for name, array in self._arrays.items()},
            **{f"optimiser.{i}": np.array(leaf) for i, leaf in enumerate(leaves)},
        }

    def resume(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from a state."""
        jax, _ = load_jax()
        own = self.state()
        wrong = [name for name in own if name not in state or np.shape(state[name]) != own[name].shape]
        if wrong or len(state) != len(own):
            raise UsageError(
                f"checkpoint: expected the arrays of a network of {self.settings.n_units} units, was other ones in "
                f"{', '.join(wrong[:3]) or 'number'}. Take the settings that it was made with."
            )
        leaves, tree = jax.tree_util.tree_flatten(self._optimiser)
        parts = [np.asarray(state[f"optimiser.{i}"]) for i in range(len(leaves))]
        self._optimiser = jax.tree_util.tree_unflatten(tree, parts)
        self._arrays = {name: np.asarray(state[f"network.{name}"]) for name in self._arrays}
        if self._doping is not None:
            self._doping.costs = np.array(state["case_costs"], np.float64)
        self.n_rounds = int(state["n_rounds"])

    def _fly(self, flight: "_Flight", rng: np.random.Generator) -> Segments:
        t, n = self.settings.horizon, self.n_envs
        policy, first_memory, rows = self.policy(), flight.memory.copy(), []
        spread = np.exp(np.array(self._arrays["log_spread"])) if "log_spread" in self._arrays else None
        for _ in range(t):
            flight.memory[flight.starts] = 0.0
            outputs, after = policy.outputs(flight.observed, flight.memory)
            chosen, log_likely = _drawn(outputs, spread, rng)
            actions = chosen if spread is None else np.tanh(chosen)
            observed, rewards, terminated, truncated, infos = self.envs.step(actions)
            ends = np.asarray(terminated) | np.asarray(truncated)
            # In the next step the environment starts again, and takes no action.
            is_step = ~flight.ends if not self._resets_at_once else np.ones(n, np.bool_)
            paid = np.asarray(rewards) - self._cost(np.asarray(observed), ends) - self._cost_of_ends(infos, ends)
            paid += self.settings.discount * self._values_of_cut_off(
                np.asarray(truncated), observed, infos, after, policy
            )
            rows.append((flight.observed, flight.starts, chosen, log_likely, paid, ends, is_step))
            flight.count(np.asarray(rewards), ends, infos)
            if self._doping is not None and ends.any():
                self._doping.count(infos, ends)
            flight.starts = ends.copy() if self._resets_at_once else flight.ends.copy()
            flight.observed, flight.memory, flight.ends = np.asarray(observed)[:, self._places], after, ends
        columns = list(zip(*rows, strict=True))
        return Segments(
            observed=np.stack([*columns[0], flight.observed]).astype(np.float32),
            starts=np.stack([*columns[1], flight.starts]),
            memory=first_memory,
            chosen=np.stack(columns[2]),
            log_likely=np.stack(columns[3]).astype(np.float32),
            rewards=np.stack(columns[4]).astype(np.float32),
            ends=np.stack(columns[5]),
            weights=np.stack(columns[6]).astype(np.float32),
        )

    # A time limit cuts a search off and does not end the task: what would have come is worth what the network says of
    # the last observation (Pardo et al. 2018, Time limits in reinforcement learning, arXiv 1712.00378, section 4).
    def _values_of_cut_off(
        self,
        truncated: NDArray[np.bool_],
        observed: NDArray[np.float32],
        infos: Mapping[str, Any],
        memory: NDArray[Any],
        policy: GruPolicy,
    ) -> NDArray[np.float64]:
        values = np.zeros(self.n_envs)
        if truncated.any():
            last = np.stack(infos["final_obs"][truncated]) if self._resets_at_once else np.asarray(observed)[truncated]
            _, after = policy.outputs(np.asarray(last, np.float32)[:, self._places], memory[truncated])
            values[truncated] = after @ np.array(self._arrays["value"]) + np.array(self._arrays["value_bias"])
        return values

    # Of an end the next search is seen already.
    def _cost(self, observed: NDArray[np.float32], ends: NDArray[np.bool_]) -> NDArray[np.float64] | float:
        if self._refused is None:
            return 0.0
        return np.where(ends, 0.0, self.settings.refused_cost * (observed[:, self._refused] > 0.5))

    def _cost_of_ends(self, infos: Mapping[str, Any], ends: NDArray[np.bool_]) -> NDArray[np.float64] | float:
        if self.settings.collision_cost == 0.0 or not ends.any():
            return 0.0
        outcomes = np.asarray(infos.get("final_info", infos).get("outcome", np.full(len(ends), None)), dtype=object)
        return np.where(ends & (outcomes == COLLISION), self.settings.collision_cost, 0.0)

    def _learn(self, flown: Segments, rng: np.random.Generator) -> list[Mapping[str, Any]]:
        s = self.settings
        values = np.array(self._values_of(self._arrays, flown.observed, flown.starts, flown.memory))
        gains = advantages(flown.rewards, values, flown.ends, discount=s.discount, trace=s.trace)
        returns = gains + values[:-1]
        used = flown.weights > 0
        gains = (gains - gains[used].mean()) / (gains[used].std() + 1e-8)
        figures = []
        for _ in range(s.epochs):
            for agents in np.split(rng.permutation(self.n_envs), s.parts):
                part = {
                    "observed": flown.observed[:-1, agents], "starts": flown.starts[:-1, agents],
                    "memory": flown.memory[agents], "chosen": flown.chosen[:, agents],
                    "log_likely": flown.log_likely[:, agents], "advantages": gains[:, agents],
                    "returns": returns[:, agents], "weights": flown.weights[:, agents],
                }  # fmt: skip
                self._arrays, self._optimiser, losses = self._update(self._arrays, self._optimiser, part)
                figures.append(losses)
        return figures


class _Flight:
    """State of the searches between two segments, and outcomes of those that have ended."""

    def __init__(self, *, observed: NDArray[np.float32], memory: NDArray[Any], starts: NDArray[np.bool_]) -> None:
        self.observed, self.memory, self.starts = observed, memory, starts
        self.ends = np.zeros(len(starts), np.bool_)
        self.sums: list[float] = []
        self.successes: list[bool] = []
        self._sum = np.zeros(len(starts))
        self._has_ended = np.zeros(len(starts), np.bool_)

    @property
    def success(self) -> float:
        """The share of successes among the searches that have ended, or had all the round for it."""
        n = len(self.successes) + int((~self._has_ended).sum())
        return sum(self.successes) / n

    def count(self, rewards: NDArray[Any], ends: NDArray[np.bool_], infos: Mapping[str, Any]) -> None:
        self._sum += rewards
        if not ends.any():
            return
        self._has_ended |= ends
        self.sums += self._sum[ends].tolist()
        self._sum[ends] = 0.0
        found = infos.get("success", infos.get("final_info", {}).get("success"))
        if found is not None:
            self.successes += np.asarray(found)[ends].astype(bool).tolist()


def _drawn(
    outputs: NDArray[Any], spread: NDArray[Any] | None, rng: np.random.Generator
) -> tuple[NDArray[Any], NDArray[Any]]:
    if spread is not None:
        z = rng.standard_normal(outputs.shape, dtype=np.float32)
        return outputs + spread * z, (-0.5 * z**2 - np.log(spread) - 0.5 * np.log(2 * np.pi)).sum(axis=1)
    logs = outputs - np.max(outputs, axis=1, keepdims=True)
    logs = logs - np.log(np.exp(logs).sum(axis=1, keepdims=True))
    chosen = np.argmax(logs + rng.gumbel(size=logs.shape), axis=1)
    return chosen, np.take_along_axis(logs, chosen[:, None], axis=1)[:, 0]
