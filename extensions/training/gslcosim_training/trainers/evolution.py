"""Evolution strategies by pycma: of recurrent networks in batches, and of a method's parameters in runs."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.bundled import bundled_agents
from gslcosim.base.errors import MethodError, SimulationFault, UsageError
from gslcosim.base.problems import Problem
from gslcosim.base.rng import stream
from gslcosim.contract.messages import ParameterValue
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.methods.card import MethodCard, find_unmet_needs
from gslcosim.runtime.status import RunResult
from gslcosim.scenario.checks.registry import list_scenario_checks
from gslcosim.scenario.loader import LoadedScenario, resolve_values
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim.scenario.problems import did_you_mean
from gslcosim.scenario.serialization import plain_values
from gslcosim_bench.cases.agent_setup import apply_entry, find_card
from gslcosim_bench.cases.models import EntrySpec, Trial
from gslcosim_bench.execution.scoring import COMPLETED, Row
from gslcosim_bench.execution.trial import EnvironmentCache, record_trial, run_trial
from gslcosim_search.learned.policy import ActionSettings
from gslcosim_search.learned.recurrent_networks import CtrnnPolicy
from gslcosim_training.trainers.search_pool import SearchPool
from gslcosim_training.trainers.trainer import CtrnnSettings, MethodSettings, Weights, check_state, run_searches

# What a number of 1 in the genome makes of weights, biases, and powers of e in time constants.
_WEIGHT, _INPUT, _BIAS = 2.0, 4.0, 1.0
# Of a case's mean cost: the last generation counts a half.
_NEWEST = 0.5
# Time constants are e times the time of a step to begin with.
_MOST_LOG_TAU = 5.0
_DIGITS = 4


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
        """Live through the generations of a state again."""
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
            "trainer: expected pycma, which evolves, was none. Install it: pip install 'gslcosim-training[train]'"
        ) from error
    return cma


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


@dataclass(frozen=True, kw_only=True)
class CaseRun:
    """A method in a case of a family.

    Args:
        family: Name of the family.
        case: The case.
        entry: The method, as a suite enters it.
    """

    family: str
    case: LoadedScenario
    entry: EntrySpec

    def check(self) -> None:
        """Check that the method has all that it needs in the case."""
        self._trial()

    def row(self, rooms: EnvironmentCache) -> Row:
        """Fly, and return the row that a benchmark has of such a flight."""
        trial = self._trial()
        folder = prepare_environment(self.case.scenario, scenario_dir=self.case.directory)
        row = run_trial(trial, folder, rooms).row
        if row["status"] != COMPLETED:
            raise SimulationFault(f"family {self.family}: {trial.id}: {row['fault']}")
        if row["agent_faults"]:
            raise MethodError(f"family {self.family}: {trial.id}: expected no faults, was {row['agent_faults']}")
        return row

    def record(self, runs_dir: Path) -> RunResult:
        """Fly with a recording into a run's folder of its own below `runs_dir`."""
        return record_trial(self._trial(), runs_dir)

    def _trial(self) -> Trial:
        case, directory = self.case, self.case.directory
        values = apply_entry(
            case.scenario, case.name, self.entry, card=find_card(self.entry, directory), directory=directory,
            scenario_dir=directory,
        )  # fmt: skip
        source = f"family {self.family}: entry {self.entry.name}"
        flown = resolve_values(values, directory, source=source, checks=list_scenario_checks("agents"))
        name = f"{case.name}/{case.scenario.seed}"
        return Trial(
            id=f"{self.entry.name}/{name}", index=0, case=name, scenario=case.name, family=self.family, varied="{}",
            repetition=0, entry=self.entry.name, is_control=False, scenario_json=json.dumps(plain_values(flown)),
            directory=directory, room="", tape=None, case_hash=name,
            sources=(case.path.absolute(),),
        )  # fmt: skip


def compute_rows(family: str, cases: Sequence[LoadedScenario], entry: EntrySpec) -> list[Row]:
    """Return a row for the flight of a method in each case, in their order; see `CaseRun.row`."""
    rooms = EnvironmentCache()
    return [CaseRun(family=family, case=case, entry=entry).row(rooms) for case in cases]


@dataclass(frozen=True, kw_only=True)
class EvolvedParameters:
    """A method with parameters that were evolved."""

    entry: EntrySpec

    @property
    def parameters(self) -> dict[str, ParameterValue]:
        """The parameters, as scenarios take them."""
        return dict(self.entry.parameters)


class EvolvedMethod:
    """Evolves parameters of a method within ranges; its policy are the parameters at the centre of the distribution.

    It begins at the method's own defaults. The robots have the sensors of the family's cases.

    Args:
        family: Name of the family.
        cases: Of training.
        settings: Of the trainer.
        seed: Of the training.
        weights: From mean costs of the cases to how often each comes; see `Family.weights`.

    Source:
        Duisterhof et al. 2021, Sniffy Bug, IROS; the strategy is CMA-ES in place of their genetic algorithm, and the
        cost is restricted time and nearest distance in place of the mean distance.
    """

    def __init__(
        self, family: str, cases: Sequence[LoadedScenario], *, settings: MethodSettings, seed: int, weights: Weights
    ) -> None:
        self.family, self.cases, self.settings = family, tuple(cases), settings
        self.seed, self.weights = seed, weights
        if problem := next(find_method_settings_problems(settings), None):
            raise UsageError(str(problem))
        self._card = _find_method_card(settings)
        CaseRun(family=family, case=self.cases[0], entry=self._entry({})).check()
        self._begin = np.array([self._place_of_default(name) for name in settings.ranges])
        self._evolution = Evolution(
            len(settings.ranges), population=settings.population, spread=settings.spread, seed=seed
        )
        self._costs = np.full(len(cases), np.nan)
        self._n_flights = 0

    @property
    def is_over(self) -> bool:
        """See `Trainer`."""
        return self._evolution.n_generations >= self.settings.rounds

    def policy(self) -> EvolvedParameters:
        """Return the parameters at the centre of the distribution."""
        return self._with(self._evolution.centre)

    def step(self) -> dict[str, float]:
        """Fly a generation; figures as of `EvolvedCtrnn`."""
        rng = stream(self.seed, f"training.generation.{self._evolution.n_generations}")
        k = min(self.settings.cases_per_round, len(self.cases))
        chosen = rng.choice(len(self.cases), size=k, p=self.weights(self._costs))
        seeds = rng.integers(2**31, size=k)
        flown = [_seeded(self.cases[int(i)], int(seed)) for i, seed in zip(chosen, seeds, strict=True)]
        asked = self._evolution.ask()
        rows = [compute_rows(self.family, flown, self._with(each).entry) for each in asked]
        costs = np.array([[compute_cost(row) for row in one] for one in rows])
        self._evolution.tell(costs.mean(axis=1))
        for case, cost in zip(chosen.tolist(), costs.mean(axis=0).tolist(), strict=True):
            before = self._costs[case]
            self._costs[case] = cost if np.isnan(before) else (1 - _NEWEST) * before + _NEWEST * cost
        self._n_flights += costs.size
        return {
            "round": float(self._evolution.n_generations),
            "flights": float(self._n_flights),
            "best_cost": float(costs.mean(axis=1).min()),
            "mean_cost": float(costs.mean()),
            "success": float(np.mean([[row["success"] for row in one] for one in rows])),
            "spread": self._evolution.spread,
        }

    def state(self) -> dict[str, NDArray[Any]]:
        """See `Trainer`."""
        return {**self._evolution.state(), "case_costs": self._costs.copy(), "n_flights": np.array(self._n_flights)}

    def resume(self, state: Mapping[str, NDArray[Any]]) -> None:
        """See `Trainer`."""
        check_state(state, {"case_costs": self._costs.shape, "n_flights": ()})
        self._evolution.resume(state)
        self._costs, self._n_flights = np.array(state["case_costs"], np.float64), int(state["n_flights"])

    # From a number without bounds to one within a range: its middle at 0, its ends at -1 and 1, reflected beyond.
    def _with(self, genome: NDArray[np.float64]) -> EvolvedParameters:
        parameters: dict[str, ParameterValue] = {}
        places = (self._begin + genome).tolist()
        for place, (name, (low, high)) in zip(places, self.settings.ranges.items(), strict=True):
            share = abs(((place + 1.0) / 2.0 + 1.0) % 2.0 - 1.0)
            value = min(max(float(f"{low + share * (high - low):.{_DIGITS}g}"), low), high)
            parameters[name] = _allowed(self._card, name, value)
        return EvolvedParameters(entry=self._entry(parameters))

    def _place_of_default(self, name: str) -> float:
        (low, high), default = self.settings.ranges[name], self._card.parameters[name].default
        if not isinstance(default, int | float):
            return 0.0
        return 2.0 * min(max((float(default) - low) / (high - low), 0.0), 1.0) - 1.0

    def _entry(self, parameters: Mapping[str, ParameterValue]) -> EntrySpec:
        return build_method_entry(self.settings, parameters)


def _allowed(card: MethodCard, name: str, value: float) -> ParameterValue:
    is_whole = name in card.parameters and card.parameters[name].kind == "int"
    return round(value) if is_whole else value


def build_method_entry(settings: MethodSettings, parameters: Mapping[str, ParameterValue]) -> EntrySpec:
    """Return the method of a training as a suite enters it."""
    start = StartSpec(python=settings.method)
    return EntrySpec(name=settings.method, start=start, parameters=dict(parameters), robots=settings.robots)


def find_method_settings_problems(settings: MethodSettings) -> Iterator[Problem]:
    """Yield what is wrong with the method of a training, its robots and the ranges of its parameters.

    Args:
        settings: Of the trainer; places of problems begin with `trainer.`.
    """
    if settings.method not in bundled_agents():
        remedy = did_you_mean(settings.method, bundled_agents())
        yield Problem(where="trainer.method", expected="a bundled method", found=f"{settings.method!r}", remedy=remedy)
        return
    card = find_card(build_method_entry(settings, {}), Path())
    if card is None:
        found = f"{settings.method}, which has none"
        yield Problem(where="trainer.method", expected="a method with a card", found=found)
        return
    least, most = card.robots if isinstance(card.robots, tuple) else (card.robots, card.robots)
    if not least <= settings.robots <= most:
        expected = f"{least if least == most else f'{least} to {most}'} for {settings.method}"
        yield Problem(where="trainer.robots", expected=expected, found=f"{settings.robots}")
    if not settings.ranges:
        expected = "at least one parameter with its least and most"
        yield Problem(where="trainer.ranges", expected=expected, found="none")
    for name, (low, high) in settings.ranges.items():
        yield from _find_range_problems(card, name, low, high)


def _find_range_problems(card: MethodCard, name: str, low: float, high: float) -> Iterator[Problem]:
    place = f"trainer.ranges.{name}"
    if not low < high:
        yield Problem(where=place, expected="least below most", found=f"{low:g} and {high:g}")
    for end in (low, high):
        given = {name: _allowed(card, name, end)}
        for need in find_unmet_needs(card, sensors=(), knows=(), n_channels=0, parameters=given):
            # The others are about the scenario.
            if need.where.startswith("parameters."):
                yield Problem(where=place, expected=need.expected, found=need.found, remedy=need.remedy)
                return


def _find_method_card(settings: MethodSettings) -> MethodCard:
    card = find_card(build_method_entry(settings, {}), Path())
    assert card is not None, "a method without a card is a problem of the settings"
    return card


def compute_cost(row: Row) -> float:
    """Return the cost of a run: after success its time as a fraction of the limit, else 1 plus the remaining distance.

    cost = t / limit, or 1 + min(1, nearest distance / first distance)
    """
    if row["success"]:
        return float(row["time_s"]) / float(row["time_limit_s"])
    nearest_m = row["nearest_m"]
    first_m = math.dist((row["start_x_m"], row["start_y_m"]), (row["source_x_m"], row["source_y_m"]))
    return 2.0 if nearest_m is None or not first_m else 1.0 + min(1.0, float(nearest_m) / first_m)


def _seeded(case: LoadedScenario, seed: int) -> LoadedScenario:
    scenario = case.scenario.model_copy(update={"seed": seed})
    return LoadedScenario(scenario=scenario, path=case.path, directory=case.directory, text=case.text)
