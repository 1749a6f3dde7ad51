"""Evolution strategies with a covariance matrix, by pycma; the only import of it."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.rng import stream
from gslcosim.training.trainers.trainer import check_state


class Evolution:
    """A population whose distribution moves to where costs are low: equal costs, equal generations.

    Its state is the costs that it was given. To resume it asks and is given them again, so that it goes on to the same
    bits.

    Args:
        n: How many numbers an individual has.
        population: How many individuals a generation has.
        spread: Standard deviation of the first generation, around 0.
        seed: Of all that is drawn; no global random state is used.

    Source:
        Hansen and Ostermeier 2001, Completely derandomized self-adaptation in evolution strategies, Evolutionary
        Computation 9(2); pycma: Hansen, Akimoto, Baudis 2019, doi:10.5281/zenodo.2559634.

    Raises:
        UsageError: pycma is not installed.
    """

    def __init__(self, n: int, *, population: int, spread: float, seed: int) -> None:
        self._n, self._population, self._spread, self._seed = n, population, spread, seed
        self._costs: list[NDArray[np.float64]] = []
        self._strategy = self._begun()
        self._asked: list[NDArray[np.float64]] | None = None

    @property
    def n_generations(self) -> int:
        """Number of generations whose costs are known."""
        return len(self._costs)

    @property
    def centre(self) -> NDArray[np.float64]:
        """The mean of the distribution, (n,)."""
        return np.array(self._strategy.mean, np.float64)

    @property
    def spread(self) -> float:
        """The step size."""
        return float(self._strategy.sigma)

    def ask(self) -> NDArray[np.float64]:
        """Return the individuals of the next generation, (population, n)."""
        self._asked = [np.asarray(each, np.float64) for each in self._strategy.ask()]
        return np.array(self._asked)

    def tell(self, costs: NDArray[np.float64]) -> None:
        """Take the costs of the individuals asked for, (population,)."""
        assert self._asked is not None, "costs are told of what was asked for"
        self._strategy.tell(self._asked, [float(cost) for cost in costs])
        self._costs.append(np.array(costs, np.float64))
        self._asked = None

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all costs that were given, (generations, population)."""
        return {"told": np.array(self._costs, np.float64).reshape(-1, self._population)}

    def resume(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Live through the generations of a state again.

        Raises:
            UsageError: it is that of another population.
        """
        check_state(state, {"told": (None, self._population)})
        self._costs, self._strategy = [], self._begun()
        for costs in state["told"]:
            self.ask()
            self.tell(costs)

    def _begun(self) -> Any:
        cma, rng = _load_cma(), stream(self._seed, "training.evolution")
        options = {
            "popsize": self._population,
            "seed": math.nan,
            "randn": lambda *shape: rng.standard_normal(shape),
            "verbose": -9,
            "verb_log": 0,
            "verb_disp": 0,
        }
        return cma.CMAEvolutionStrategy(np.zeros(self._n), self._spread, options)


def _load_cma() -> Any:
    try:
        import cma
    except ImportError as error:
        raise UsageError(
            "trainer: expected pycma, which evolves, found none. Install it with: pip install 'gslcosim[train]'"
        ) from error
    return cma
