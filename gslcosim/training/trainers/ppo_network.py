"""The network of recurrent PPO in JAX, its loss and its updates; `GruPolicy` flies the same arrays in numpy.

One thread and float32: the same numbers come out each time on one machine.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import UsageError

Arrays = dict[str, Any]
_ONE_THREAD = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
# Of an array that begins as small as if it were not there: then every action is as likely as its opposite.
_SMALL = 0.01


def load_jax() -> tuple[Any, Any]:
    """Return JAX and optax.

    Raises:
        UsageError: one of them is not installed.
    """
    # Read when JAX is imported first.
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {_ONE_THREAD}".strip()
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    try:
        import jax
        import optax
    except ImportError as error:
        raise UsageError(
            f"trainer: recurrent_ppo needs {error.name}, which is not installed. Install it: "
            "pip install 'gslcosim[train]'"
        ) from error
    return jax, optax


@dataclass(frozen=True, kw_only=True)
class Segments:
    """What n agents have done in t steps: time first, agents second; `observed` and `starts` have t + 1 rows.

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


def first_arrays(rng: np.random.Generator, *, k: int, m: int, h: int, o: int, is_continuous: bool) -> Arrays:
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
def updater(settings: Any, n_updates: int) -> tuple[Callable[[Arrays], Any], Callable[..., Any], Callable[..., Any]]:
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
