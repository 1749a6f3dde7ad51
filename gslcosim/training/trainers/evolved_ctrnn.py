"""Evolution of continuous-time recurrent networks: all of a generation search in the same cases at once."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.rng import stream
from gslcosim.search.learned.policies.ctrnn import CtrnnPolicy
from gslcosim.search.learned.policies.policy import ActionSettings
from gslcosim.training.trainers.curriculum import Weights
from gslcosim.training.trainers.evolution import Evolution
from gslcosim.training.trainers.policy_costs import run_searches
from gslcosim.training.trainers.search_pool import SearchPool
from gslcosim.training.trainers.trainer import CtrnnSettings, check_state

# What a number of 1 in the genome makes of weights, biases, and powers of e in time constants.
_WEIGHT, _INPUT, _BIAS = 2.0, 4.0, 1.0
# Of a case's mean cost: the last generation counts a half.
_NEWEST = 0.5
# Time constants are e times the time of a step to begin with.
_MOST_LOG_TAU = 5.0


class EvolvedCtrnn:
    """Evolves a `CtrnnPolicy`; its policy is the centre of the distribution.

    Args:
        pool: The cases of training, with a search for each individual and case of a generation.
        action: What actions mean; `hold_s` is the time of a step.
        settings: Of the trainer.
        seed: Of the training.
        weights: From mean costs of the cases, NaN where not flown, to how often each comes; see `Family.weights`.

    Source:
        CTRNNs evolved for odour sources: de Croon, O'Connor, Nicol, Izzo 2013, Evolutionary robotics approach to odor
        source localization, Neurocomputing 121. The strategy is CMA-ES in place of their genetic algorithm.
    """

    def __init__(
        self, pool: SearchPool, *, action: ActionSettings, settings: CtrnnSettings, seed: int, weights: Weights
    ) -> None:
        self.pool, self.action, self.settings, self.seed, self.weights = pool, action, settings, seed, weights
        self.names = settings.observations
        self._places = pool.places_of(self.names)
        h, k, o = settings.n_neurons, len(self.names), action.n_outputs
        self._shapes = {
            "tau_s": (h,), "recurrent": (h, h), "bias": (h,), "inputs": (h, k), "outputs": (o, h), "output_bias": (o,),
        }  # fmt: skip
        n = sum(int(np.prod(shape)) for shape in self._shapes.values())
        self._evolution = Evolution(n, population=settings.population, spread=settings.spread, seed=seed)
        self._costs = np.full(pool.n_cases, np.nan)
        self._n_steps = 0

    @property
    def is_over(self) -> bool:
        """See `Trainer`."""
        return self._evolution.n_generations >= self.settings.rounds

    def policy(self) -> CtrnnPolicy:
        """Return the network at the centre of the distribution."""
        return self._network(self._evolution.centre)

    def step(self) -> dict[str, float]:
        """Fly a generation; figures: least and mean cost, share of searches that succeed, and the step size."""
        rng = stream(self.seed, f"training.generation.{self._evolution.n_generations}")
        k = self.settings.cases_per_round
        cases = rng.choice(self.pool.n_cases, size=k, p=self.weights(self._costs))
        seeds = rng.integers(2**31, size=k)
        genomes = self._evolution.ask()
        flown = run_searches(self.pool.envs, [self._network(each) for each in genomes], cases, seeds, self._places)
        limits_s, diagonals_m = self.pool.scales(np.tile(cases, len(genomes)))
        costs = flown.costs(limits_s, diagonals_m).reshape(len(genomes), k)
        self._evolution.tell(costs.mean(axis=1))
        self._remember(cases, costs.mean(axis=0))
        self._n_steps += flown.n_steps
        return {
            "round": float(self._evolution.n_generations),
            "steps": float(self._n_steps),
            "best_cost": float(costs.mean(axis=1).min()),
            "mean_cost": float(costs.mean()),
            "success": float(flown.success.mean()),
            "spread": self._evolution.spread,
        }

    def state(self) -> dict[str, NDArray[Any]]:
        """See `Trainer`."""
        return {**self._evolution.state(), "case_costs": self._costs.copy(), "n_steps": np.array(self._n_steps)}

    def resume(self, state: Mapping[str, NDArray[Any]]) -> None:
        """See `Trainer`."""
        check_state(state, {"case_costs": self._costs.shape, "n_steps": ()})
        self._evolution.resume(state)
        self._costs, self._n_steps = np.array(state["case_costs"], np.float64), int(state["n_steps"])

    def _remember(self, cases: NDArray[np.int64], costs: NDArray[np.float64]) -> None:
        for case, cost in zip(cases.tolist(), costs.tolist(), strict=True):
            before = self._costs[case]
            self._costs[case] = cost if np.isnan(before) else (1 - _NEWEST) * before + _NEWEST * cost

    def _network(self, genome: NDArray[np.float64]) -> CtrnnPolicy:
        arrays: dict[str, NDArray[Any]] = {}
        begin = 0
        for name, shape in self._shapes.items():
            size = int(np.prod(shape))
            arrays[name] = genome[begin : begin + size].reshape(shape)
            begin += size
        dt_s = self.pool.step_s
        arrays["tau_s"] = dt_s * np.exp(np.clip(1.0 + arrays["tau_s"], -_MOST_LOG_TAU, _MOST_LOG_TAU))
        for name, scale in (
            ("recurrent", _WEIGHT), ("bias", _BIAS), ("inputs", _INPUT), ("outputs", _WEIGHT), ("output_bias", _BIAS),
        ):  # fmt: skip
            arrays[name] = scale * arrays[name]
        singles = {name: np.ascontiguousarray(array, np.float32) for name, array in arrays.items()}
        settings = {"dt_s": dt_s, "spread": self.settings.flown_spread}
        return CtrnnPolicy.of_arrays(self.names, self.action, singles, settings)
