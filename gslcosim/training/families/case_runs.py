"""Runs of methods in the cases of a family, in this process, as `gslcosim up` runs them."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.errors import MethodError, SimulationFault
from gslcosim.bench.cases.agent_setup import apply_entry, find_card
from gslcosim.bench.cases.models import EntrySpec
from gslcosim.bench.cases.trials import Trial
from gslcosim.bench.execution.scoring import COMPLETED, Row
from gslcosim.bench.execution.trial import EnvironmentCache, record_trial, run_trial
from gslcosim.environment.generation import prepare_environment
from gslcosim.runtime.status import RunResult
from gslcosim.scenario.loader import LoadedScenario, resolve_values
from gslcosim.scenario.serialization import plain_values
from gslcosim_services.sensing.method_checks import find_method_problems


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
        """Check that the method has all that it needs in the case.

        Raises:
            ScenarioError: it lacks something.
        """
        self._trial()

    def row(self, rooms: EnvironmentCache) -> Row:
        """Fly, and return the row that a benchmark has of such a flight.

        Raises:
            ScenarioError: the method lacks something.
            SimulationFault: a service failed.
            MethodError: the method did something wrong.
        """
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
        flown = resolve_values(values, directory, source=source, checks=(find_method_problems,))
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
