"""Gated recurrent units, as recurrent reinforcement learning trains them."""

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.learned.policies.policy import (
    Actions,
    ActionSettings,
    Floats,
    Policy,
    add_spread,
    check_arrays,
    read_spread,
)


class GruPolicy(Policy):
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
        self._arrays: dict[str, NDArray[Any]] = {
            "encoder": encoder, "encoder_bias": encoder_bias, "gates": gates, "gates_bias": gates_bias,
            "recurrent_gates": recurrent_gates, "recurrent_bias": recurrent_bias, "outputs": outputs,
            "output_bias": output_bias,
        }  # fmt: skip
        self._n_units = recurrent_gates.shape[1]
        self._encoder, self._gates, self._recurrent_gates, self._outputs = (
            np.ascontiguousarray(array.T) for array in (encoder, gates, recurrent_gates, outputs)
        )

    def memory(self, n: int) -> Floats:
        """Return units at 0, (n, h); see `Policy`."""
        return np.zeros((n, self._n_units), np.float32)

    def act(self, observations: Floats, memory: Floats) -> tuple[Actions, Floats]:
        """Step the units once and read them; see `Policy`."""
        outputs, after = self.outputs(observations, memory)
        return self.action.chosen(add_spread(outputs, observations, self.spread)), after

    def outputs(self, observations: Floats, memory: Floats) -> tuple[Floats, Floats]:
        """Return what an action is chosen by, (n, o), and the next memory; as `act`."""
        h, one = self._n_units, np.float32(1.0)
        encoded = np.tanh(observations @ self._encoder + self._arrays["encoder_bias"])
        fed = encoded @ self._gates + self._arrays["gates_bias"]
        recurrent = memory @ self._recurrent_gates + self._arrays["recurrent_bias"]
        both = np.float32(0.5) * (one + np.tanh(np.float32(0.5) * (fed[:, : 2 * h] + recurrent[:, : 2 * h])))
        reset, kept = both[:, :h], both[:, h:]
        new = np.tanh(fed[:, 2 * h :] + reset * recurrent[:, 2 * h :])
        after = (one - kept) * new + kept * memory
        return after @ self._outputs + self._arrays["output_bias"], after

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `Policy`."""
        return dict(self._arrays)

    @property
    def settings(self) -> dict[str, Any]:
        """See `Policy`."""
        return {"spread": self.spread}

    @classmethod
    def of_arrays(
        cls,
        observation_names: tuple[str, ...],
        action: ActionSettings,
        arrays: Mapping[str, NDArray[Any]],
        settings: Mapping[str, Any],
    ) -> Self:
        """Return the network; see `Policy`."""
        spread = read_spread(settings, action)
        k, o = len(observation_names), action.n_outputs
        ends = check_arrays(arrays, {"encoder": (None, k), "outputs": (o, None)})
        m, h = len(ends["encoder"]), ends["outputs"].shape[1]
        shapes = {
            "encoder_bias": (m,), "gates": (3 * h, m), "gates_bias": (3 * h,), "recurrent_gates": (3 * h, h),
            "recurrent_bias": (3 * h,), "output_bias": (o,),
        }  # fmt: skip
        return cls(observation_names, action, **ends, **check_arrays(arrays, shapes), spread=spread)
