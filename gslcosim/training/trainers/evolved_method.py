"""Evolution of a method's parameters in runs of this process, as Sniffy Bug's swarm was evolved."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.rng import stream
from gslcosim.bench.cases.agent_setup import find_card
from gslcosim.bench.cases.models import EntrySpec
from gslcosim.bench.execution.scoring import Row
from gslcosim.contract.messages import ParameterValue
from gslcosim.methods.card import MethodCard
from gslcosim.methods.needs import find_unmet_needs
from gslcosim.scenario.bundled import bundled_agents
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim.training.families.case_runs import CaseRun, compute_rows
from gslcosim.training.trainers.curriculum import Weights
from gslcosim.training.trainers.evolution import Evolution
from gslcosim.training.trainers.trainer import MethodSettings, check_state

_DIGITS = 4
# Of a case's mean cost: the last generation counts a half.
_NEWEST = 0.5


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

    Raises:
        UsageError: the method, or a parameter of it, is not there, or so many robots cannot fly it.
        ScenarioError: the method lacks something in the cases.

    Source:
        Duisterhof et al. 2021, Sniffy Bug, IROS; the strategy is CMA-ES in place of their genetic algorithm, and the
        cost is restricted time and nearest distance in place of the mean distance.
    """

    def __init__(
        self, family: str, cases: Sequence[LoadedScenario], *, settings: MethodSettings, seed: int, weights: Weights
    ) -> None:
        self.family, self.cases, self.settings = family, tuple(cases), settings
        self.seed, self.weights = seed, weights
        if settings.method not in bundled_agents():
            raise UsageError(f"trainer.method: expected a bundled method, was {settings.method!r}.")
        self._card = _card_for(settings, self._entry({}))
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
        s = self.settings
        return EntrySpec(name=s.method, start=StartSpec(python=s.method), parameters=dict(parameters), robots=s.robots)


def _allowed(card: MethodCard, name: str, value: float) -> ParameterValue:
    is_whole = name in card.parameters and card.parameters[name].kind == "int"
    return round(value) if is_whole else value


# Checked before anything is flown.
def _card_for(settings: MethodSettings, entry: EntrySpec) -> MethodCard:
    card = find_card(entry, Path())
    if card is None:
        raise UsageError(f"trainer.method: expected a method with a card, was {settings.method}, which has none.")
    least, most = card.robots if isinstance(card.robots, tuple) else (card.robots, card.robots)
    if not least <= settings.robots <= most:
        raise UsageError(
            f"trainer.robots: expected {least if least == most else f'{least} to {most}'} for {settings.method}, was "
            f"{settings.robots}."
        )
    if not settings.ranges:
        raise UsageError("trainer.ranges: expected at least one parameter with its least and most, was none.")
    for name, (low, high) in settings.ranges.items():
        if not low < high:
            raise UsageError(f"trainer.ranges.{name}: expected least below most, was {low:g} and {high:g}.")
        for end in (low, high):
            given = {name: _allowed(card, name, end)}
            wrong = find_unmet_needs(card, sensors=(), knows=(), n_channels=0, parameters=given)
            for shortage in wrong:
                if shortage.part.startswith("parameters."):
                    raise UsageError(
                        f"trainer.ranges.{name}: expected {shortage.expected}, was {shortage.found}. {shortage.remedy}"
                    )
    return card


def compute_cost(row: Row) -> float:
    """Return what a flight cost: its time as a share of the limit upon success, else 1 and what is left of the way.

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
