"""Placement: the place of a new entry among a suite's other entries, from flights that are chosen one batch at a time.

The rows are those of `bench run`, in a folder of results of the suite: a later `bench run` flies the rest.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gslcosim.base.errors import UsageError
from gslcosim.scenario.problems import did_you_mean
from gslcosim_bench.cases.models import Selection, Trial, TrialSlot, derive_seed
from gslcosim_bench.cases.plan import Plan, build_plan
from gslcosim_bench.cases.plan import Progress as PlanProgress
from gslcosim_bench.cases.suite_files import LoadedSuite
from gslcosim_bench.execution.runner import SuiteRun
from gslcosim_bench.execution.scoring import COMPLETED, Row
from gslcosim_bench.results import Results
from gslcosim_bench.statistics.racing import BATCH, BUDGET_FRAC, Floats, PlaceEstimate, PlaceRace
from gslcosim_bench.store import ResultsFolder
from gslcosim_bench.studies.runner import StudyHost

Flight = tuple[str, int]
"""Case and repetition: what all entries meet alike."""


@dataclass(frozen=True, kw_only=True)
class Opponents:
    """Other entries whose rows of a suite are known.

    Attributes:
        names: Those with a row of every flight with gas.
        scores: (n, k) score of each in each flight, in the order of the plan; 0 without a result.
        left_out: Those that lack rows, with how many they have.
        is_other_software: Whether another version of the software has flown them.
    """

    names: tuple[str, ...]
    scores: Floats
    left_out: dict[str, int]
    is_other_software: bool


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Result of a race.

    Attributes:
        entry: Name of the entry.
        opponents: Entries that it raced.
        table: Score of each opponent over the whole suite.
        estimates: Estimate of the place after each batch.
        n_flights: Flights with gas that the whole suite has for an entry.
        n_flown_now: Flights of this call; the others were there.
        n_without_result: Flights that ended without a result; they count as failures.
        stopped_by: `places`, `budget`, `minutes` or `suite` (all is flown).
        folder: Where the rows are.
    """

    entry: str
    opponents: Opponents
    table: dict[str, float]
    estimates: tuple[PlaceEstimate, ...]
    n_flights: int
    n_flown_now: int
    n_without_result: int
    stopped_by: str
    folder: Path


@dataclass(frozen=True, kw_only=True)
class StopRule:
    """When a race ends.

    Attributes:
        places: Ends when so many places or fewer are possible.
        budget: Most flights; absent: 15 % of those of the suite, rounded down.
        is_over: Whether time is over; asked before each batch.
    """

    places: int = 3
    budget: int | None = None
    is_over: Callable[[], bool] = field(default=lambda: False)


def plan_placement(
    loaded: LoadedSuite, entry: str, progress: PlanProgress = lambda _: None
) -> tuple[Plan, list[Trial]]:
    """Return the plan of a suite for one entry, and its flights with gas.

    Raises:
        UsageError: the suite has no such entry.
    """
    names: dict[str, None] = {}

    def wants(slot: TrialSlot) -> bool:
        names.setdefault(slot.entry)
        return slot.entry == entry and not slot.is_control

    plan = build_plan(loaded, wants=wants, progress=progress)
    flights = [trial for trial in plan.trials if trial.entry == entry and not trial.is_control]
    if not flights:
        raise UsageError(
            f"--entry: expected an entry of {loaded.shown_path} ({', '.join(names)}), was '{entry}'. "
            f"{did_you_mean(entry, list(names))} To place a method of your own, enter it in a suite that includes this "
            "one."
        )
    return plan, flights


def find_opponents(plan: Plan, flights: Sequence[Trial], results: Results) -> Opponents:
    """Return the entries of a results folder with a row of every flight.

    Raises:
        UsageError: the results are of other cases, or no other entry has flown all of them.
    """
    entry = flights[0].entry
    found = results.manifest.get("suite_hash")
    if found != plan.suite_hash:
        raise UsageError(
            f"{results.folder}: expected results of the cases of {plan.loaded.shown_path}, with the hash "
            f"{plan.suite_hash}, was suite {results.manifest.get('suite')} with the hash {found}. Enter your method in "
            "a suite that includes the one of these results, with its seed."
        )
    by_entry: dict[str, dict[Flight, float]] = {}
    for row in results.select(is_control=False).trials.to_pylist():
        score = row["score"] if row["status"] == COMPLETED else None
        by_entry.setdefault(row["entry"], {})[row["case"], row["repetition"]] = score or 0.0
    by_entry.pop(entry, None)
    wanted = [(trial.case, trial.repetition) for trial in flights]
    complete = [name for name, scores in by_entry.items() if all(flight in scores for flight in wanted)]
    if not complete:
        most = max(by_entry.items(), key=lambda item: len(item[1]), default=None)
        was = f"{most[0]} with {len(most[1])}" if most else "none"
        raise UsageError(
            f"{results.folder}: expected an entry beside {entry} with rows of all {len(wanted)} flights with gas, the "
            f"one with most was {was}. Fly the rest: gslcosim bench run."
        )
    scores = np.array([[by_entry[name][flight] for name in complete] for flight in wanted])
    if not np.all((scores >= 0.0) & (scores <= 1.0)):
        odd = next(score for score in scores.ravel().tolist() if not 0.0 <= score <= 1.0)
        raise UsageError(
            f"{results.folder}: expected scores from 0 to 1, was {odd}. Take the folder from a copy, or fly it again."
        )
    return Opponents(
        names=tuple(complete),
        scores=scores,
        left_out={name: len(scores) for name, scores in by_entry.items() if name not in complete},
        is_other_software=results.manifest.get("software_hash") != plan.software_hash,
    )


def fly_placement(
    plan: Plan,
    flights: Sequence[Trial],
    opponents: Opponents,
    folder: ResultsFolder,
    host: StudyHost,
    stop: StopRule,
    *,
    batch: int = BATCH,
    tell: Callable[[PlaceEstimate], None] = lambda _: None,
) -> Placement:
    """Fly batches of drawn flights until the place is known well enough, and return the result.

    The draws follow from the suite's seed and the entry's name, so that the same call goes on where it stopped, and
    there is one draw to choose from.

    Args:
        flights: All flights of the entry with gas, in the order of the plan.
        folder: Where rows go; those that are there are not flown again.
        tell: Receives the estimate after each batch.

    Raises:
        KeyboardInterrupt: it was interrupted; what was flown is kept.
    """
    entry, n = flights[0].entry, len(flights)
    budget = min(n, stop.budget or max(1, math.floor(BUDGET_FRAC * n)))
    race = PlaceRace(
        opponents.scores,
        np.array([trial.case for trial in flights]),
        seed=derive_seed(plan.loaded.suite.seed, "place", entry),
        budget=budget,
    )
    rows = {row["trial"]: row for row in folder.rows()}
    estimates: list[PlaceEstimate] = []
    flown: list[Row] = []
    n_flown_now, stopped_by = 0, ""
    with host.sharing_pool() as sharing:
        while not (stopped_by := _find_stop(race, estimates, stop, budget)):
            drawn = [flights[i] for i in race.draw(min(batch, budget - len(flown)))]
            if any(trial.id not in rows for trial in drawn):
                summary = SuiteRun(
                    plan, folder, sharing.start_pool, keeps_pool=True, report=sharing.report,
                    selection=Selection((("trial", tuple(trial.id for trial in drawn)),)),
                    confirm_put_aside=sharing.confirm_put_aside,
                ).fly()  # fmt: skip
                if summary.is_interrupted:
                    raise KeyboardInterrupt
                n_flown_now += summary.n_flown
                rows = {row["trial"]: row for row in folder.rows()}
            new = [rows[trial.id] for trial in drawn]
            flown += new
            estimates.append(race.record([(row["score"] or 0.0) if row["status"] == COMPLETED else 0.0 for row in new]))
            tell(estimates[-1])
    return Placement(
        entry=entry,
        opponents=opponents,
        table=dict(zip(opponents.names, race.table.tolist(), strict=True)),
        estimates=tuple(estimates),
        n_flights=n,
        n_flown_now=n_flown_now,
        n_without_result=sum(row["status"] != COMPLETED for row in flown),
        stopped_by=stopped_by,
        folder=folder.path,
    )


def _find_stop(race: PlaceRace, estimates: Sequence[PlaceEstimate], stop: StopRule, budget: int) -> str:
    if estimates and estimates[-1].n_places <= stop.places:
        return "places"
    if not race.n_left:
        return "suite"
    if estimates and estimates[-1].n_flown >= budget:
        return "budget"
    return "minutes" if estimates and stop.is_over() else ""
