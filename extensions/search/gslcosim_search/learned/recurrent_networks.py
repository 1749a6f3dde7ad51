"""Recurrent networks of policies: continuous-time ones of evolved controllers, and gated recurrent units."""

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gslcosim_search import elementary
from gslcosim_search.learned.policy import (
    Actions,
    ActionSettings,
    ArrayPolicy,
    Floats,
    PolicyError,
    add_spread,
    check_arrays,
    check_number,
    read_spread,
)
from gslcosim_search.learned.row_products import multiply


class CtrnnPolicy(ArrayPolicy):
    """A continuous-time recurrent network of h neurons whose outputs are read by a linear layer.

    tau dy/dt = -y + W s(y + b) + V x, with s(u) = 1 / (1 + exp(-u)); for one step of `dt_s` the inputs of each neuron
    stand, so that y' = u + (y - u) exp(-dt / tau) with u = W s(y + b) + V x. The outputs are C s(y' + b) + c.

    Args:
        observation_names: See `Policy`.
        action: See `Policy`.
        dt_s: Time between two questions [s].
        tau_s: Time constants, (h,) [s].
        recurrent: W, (h, h).
        bias: b, (h,).
        inputs: V, (h, k).
        outputs: C, (o, h).
        output_bias: c, (o,).
        spread: Standard deviation of what is added to the outputs before tanh, as for a `GruPolicy`.

    Source:
        Beer 1995, On the dynamics of small continuous-time recurrent neural networks, Adaptive Behavior 3(4), eq. 1;
        the exponential step is ours, and stable for any dt.
    """

    kind: ClassVar[str] = "ctrnn"

    def __init__(
        self,
        observation_names: tuple[str, ...],
        action: ActionSettings,
        *,
        dt_s: float,
        tau_s: Floats,
        recurrent: Floats,
        bias: Floats,
        inputs: Floats,
        outputs: Floats,
        output_bias: Floats,
        spread: float = 0.0,
    ) -> None:
        super().__init__(observation_names, action)
        self.dt_s, self.spread = dt_s, spread
        self.arrays = {
            "tau_s": tau_s, "recurrent": recurrent, "bias": bias, "inputs": inputs, "outputs": outputs,
            "output_bias": output_bias,
        }  # fmt: skip
        self._bias, self._output_bias = bias, output_bias
        self._recurrent, self._inputs, self._outputs = (np.ascontiguousarray(a.T) for a in (recurrent, inputs, outputs))
        self._kept = elementary.exp_each(-dt_s / tau_s).astype(np.float32)

    @override
    def memory(self, n: int) -> Floats:
        return np.zeros((n, len(self._bias)), np.float32)

    @override
    def act(self, observations: Floats, memory: Floats) -> tuple[Actions, Floats]:
        driven = multiply(_logistic(memory + self._bias), self._recurrent) + multiply(observations, self._inputs)
        after = driven + (memory - driven) * self._kept
        outputs = multiply(_logistic(after + self._bias), self._outputs) + self._output_bias
        return self.action.chosen(add_spread(outputs, observations, self.spread)), after

    @property
    @override
    def settings(self) -> dict[str, Any]:
        return {"dt_s": self.dt_s, "spread": self.spread}

    @classmethod
    @override
    def of_arrays(
        cls,
        observation_names: tuple[str, ...],
        action: ActionSettings,
        arrays: Mapping[str, NDArray[Any]],
        settings: Mapping[str, Any],
    ) -> Self:
        dt_s = check_number(settings, "dt_s", is_above=True)
        tau_s = check_arrays(arrays, {"tau_s": (None,)})["tau_s"]
        if tau_s.min() <= 0:
            raise PolicyError(f"tau_s: expected numbers above 0, was {float(tau_s.min()):g}.")
        h, k, o = len(tau_s), len(observation_names), action.n_outputs
        shapes = {"recurrent": (h, h), "bias": (h,), "inputs": (h, k), "outputs": (o, h), "output_bias": (o,)}
        spread = read_spread(settings, action)
        return cls(observation_names, action, dt_s=dt_s, tau_s=tau_s, spread=spread, **check_arrays(arrays, shapes))


def _tanh(u: Floats) -> Floats:
    return elementary.tanh_each(u).astype(np.float32)


# By tanh, which overflows nowhere.
def _logistic(u: Floats) -> Floats:
    return np.float32(0.5) * (np.float32(1.0) + _tanh(np.float32(0.5) * u))


class GruPolicy(ArrayPolicy):
    """A layer of tanh, h gated recurrent units, and a linear layer whose outputs are the actions.

    e = tanh(E x + e0); r, z = s(R e + r0 + R' h), s(Z e + z0 + Z' h); n = tanh(N e + n0 + r (N' h + n0'));
    h' = (1 - z) n + z h; the outputs are C h' + c. R, Z and N are stacked in `gates`, their twins in
    `recurrent_gates`, in this order: the weights of PyTorch's GRU fit as they are.

    Args:
        observation_names: See `Policy`.
        action: See `Policy`.
        encoder: E, (m, k).
        encoder_bias: e0, (m,).
        gates: R, Z, N, (3 h, m).
        gates_bias: r0, z0, n0, (3 h,).
        recurrent_gates: R', Z', N', (3 h, h).
        recurrent_bias: Of the same, of which usually n0' alone is not zero, (3 h,).
        outputs: C, (o, h).
        output_bias: c, (o,).
        spread: Standard deviation of what is added to the outputs before tanh; 0 flies the mean. What is added
            follows from the bits of the observation: see `normal_numbers`.

    Source:
        Cho et al. 2014, arXiv 1406.1078, with the reset gate behind the product, as cuDNN and PyTorch have it.
    """

    kind: ClassVar[str] = "gru"

    def __init__(
        self,
        observation_names: tuple[str, ...],
        action: ActionSettings,
        *,
        encoder: Floats,
        encoder_bias: Floats,
        gates: Floats,
        gates_bias: Floats,
        recurrent_gates: Floats,
        recurrent_bias: Floats,
        outputs: Floats,
        output_bias: Floats,
        spread: float = 0.0,
    ) -> None:
        super().__init__(observation_names, action)
        self.spread = spread
        self.arrays = {
            "encoder": encoder, "encoder_bias": encoder_bias, "gates": gates, "gates_bias": gates_bias,
            "recurrent_gates": recurrent_gates, "recurrent_bias": recurrent_bias, "outputs": outputs,
            "output_bias": output_bias,
        }  # fmt: skip
        self._n_units = recurrent_gates.shape[1]
        self._encoder, self._gates, self._recurrent_gates, self._outputs = (
            np.ascontiguousarray(array.T) for array in (encoder, gates, recurrent_gates, outputs)
        )

    @override
    def memory(self, n: int) -> Floats:
        return np.zeros((n, self._n_units), np.float32)

    @override
    def act(self, observations: Floats, memory: Floats) -> tuple[Actions, Floats]:
        outputs, after = self.outputs(observations, memory)
        return self.action.chosen(add_spread(outputs, observations, self.spread)), after

    def outputs(self, observations: Floats, memory: Floats) -> tuple[Floats, Floats]:
        """Return the outputs from which an action is chosen, (n, o), and the next memory; as `act`."""
        h, one = self._n_units, np.float32(1.0)
        encoded = _tanh(multiply(observations, self._encoder) + self.arrays["encoder_bias"])
        fed = multiply(encoded, self._gates) + self.arrays["gates_bias"]
        recurrent = multiply(memory, self._recurrent_gates) + self.arrays["recurrent_bias"]
        both = _logistic(fed[:, : 2 * h] + recurrent[:, : 2 * h])
        reset, kept = both[:, :h], both[:, h:]
        new = _tanh(fed[:, 2 * h :] + reset * recurrent[:, 2 * h :])
        after = (one - kept) * new + kept * memory
        return multiply(after, self._outputs) + self.arrays["output_bias"], after

    @property
    @override
    def settings(self) -> dict[str, Any]:
        return {"spread": self.spread}

    @classmethod
    @override
    def of_arrays(
        cls,
        observation_names: tuple[str, ...],
        action: ActionSettings,
        arrays: Mapping[str, NDArray[Any]],
        settings: Mapping[str, Any],
    ) -> Self:
        spread = read_spread(settings, action)
        k, o = len(observation_names), action.n_outputs
        ends = check_arrays(arrays, {"encoder": (None, k), "outputs": (o, None)})
        m, h = len(ends["encoder"]), ends["outputs"].shape[1]
        shapes = {
            "encoder_bias": (m,), "gates": (3 * h, m), "gates_bias": (3 * h,), "recurrent_gates": (3 * h, h),
            "recurrent_bias": (3 * h,), "output_bias": (o,),
        }  # fmt: skip
        return cls(observation_names, action, **ends, **check_arrays(arrays, shapes), spread=spread)
