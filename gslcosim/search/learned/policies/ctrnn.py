"""Continuous-time recurrent neural networks of evolved robot controllers."""

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.learned.policies.policy import (
    Actions,
    ActionSettings,
    Floats,
    Policy,
    PolicyError,
    add_spread,
    check_arrays,
    check_number,
    read_spread,
)


class CtrnnPolicy(Policy):
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
        self._arrays: dict[str, NDArray[Any]] = {
            "tau_s": tau_s, "recurrent": recurrent, "bias": bias, "inputs": inputs, "outputs": outputs,
            "output_bias": output_bias,
        }  # fmt: skip
        self._bias, self._output_bias = bias, output_bias
        self._recurrent, self._inputs, self._outputs = (np.ascontiguousarray(a.T) for a in (recurrent, inputs, outputs))
        self._kept = np.exp(-dt_s / tau_s).astype(np.float32)

    def memory(self, n: int) -> Floats:
        """Return neurons at rest, (n, h); see `Policy`."""
        return np.zeros((n, len(self._bias)), np.float32)

    def act(self, observations: Floats, memory: Floats) -> tuple[Actions, Floats]:
        """Step the neurons once and read them; see `Policy`."""
        driven = _logistic(memory + self._bias) @ self._recurrent + observations @ self._inputs
        after = driven + (memory - driven) * self._kept
        outputs = _logistic(after + self._bias) @ self._outputs + self._output_bias
        return self.action.chosen(add_spread(outputs, observations, self.spread)), after

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `Policy`."""
        return dict(self._arrays)

    @property
    def settings(self) -> dict[str, Any]:
        """See `Policy`."""
        return {"dt_s": self.dt_s, "spread": self.spread}

    @classmethod
    def of_arrays(
        cls,
        observation_names: tuple[str, ...],
        action: ActionSettings,
        arrays: Mapping[str, NDArray[Any]],
        settings: Mapping[str, Any],
    ) -> Self:
        """Return the network; see `Policy`."""
        dt_s = check_number(settings, "dt_s", is_above=True)
        tau_s = check_arrays(arrays, {"tau_s": (None,)})["tau_s"]
        if tau_s.min() <= 0:
            raise PolicyError(f"tau_s: expected numbers above 0, was {float(tau_s.min()):g}.")
        h, k, o = len(tau_s), len(observation_names), action.n_outputs
        shapes = {"recurrent": (h, h), "bias": (h,), "inputs": (h, k), "outputs": (o, h), "output_bias": (o,)}
        spread = read_spread(settings, action)
        return cls(observation_names, action, dt_s=dt_s, tau_s=tau_s, spread=spread, **check_arrays(arrays, shapes))


# By tanh, which overflows nowhere.
def _logistic(u: Floats) -> Floats:
    return np.float32(0.5) * (np.float32(1.0) + np.tanh(np.float32(0.5) * u))
