"""Flights of methods in the cases of a family: in this process, of the shape that `gslcosim up` has."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gslcosim.benchmark.execution.flying import Rooms, fly_trial, record_trial
from gslcosim.benchmark.execution.judging import FLOWN, Row
from gslcosim.benchmark.suite.equipping import card_of, with_entry
from gslcosim.benchmark.suite.models import EntrySpec
from gslcosim.benchmark.suite.trials import Trial
from gslcosim.errors import MethodError, SimulationFault
from gslcosim.generation import prepare_environment
from gslcosim.runtime.status import FlightResult
from gslcosim.scenario.dumping import plain_values
from gslcosim.scenario.loading import LoadedScenario, resolve_values
from gslcosim.sensing.method_checks import problems_of_methods


@dataclass(frozen=True, kw_only=True)
class CaseFlight:
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

    def row(self, rooms: Rooms) -> Row:
        """Fly, and return the row that a benchmark has of such a flight.

        Raises:
            ScenarioError: the method lacks something.
            SimulationFault: a service failed.
            MethodError: the method did something wrong.
        """
        trial = self._trial()
        folder = prepare_environment(self.case.scenario, scenario_dir=self.case.directory)
        row = fly_trial(trial, folder, rooms).row
        if row["status"] != FLOWN:
            raise SimulationFault(f"family {self.family}: {trial.id}: {row['fault']}")
        if row["agent_faults"]:
            raise MethodError(f"family {self.family}: {trial.id}: expected no faults, was {row['agent_faults']}")
        return row

    def record(self, runs_dir: Path) -> FlightResult:
        """Fly with a recording into a run's folder of its own below `runs_dir`."""
        return record_trial(self._trial(), runs_dir)

    def _trial(self) -> Trial:
        case, directory = self.case, self.case.directory
        values = with_entry(
            case.scenario, case.name, self.entry, card=card_of(self.entry, directory), directory=directory,
            scenario_dir=directory,
        )  # fmt: skip
        source = f"family {self.family}: entry {self.entry.name}"
        flown = resolve_values(values, directory, source=source, checks=(problems_of_methods,))
        name = f"{case.name}/{case.scenario.seed}"
        return Trial(
            id=f"{self.entry.name}/{name}", index=0, case=name, scenario=case.name, family=self.family, varied="{}",
            repetition=0, entry=self.entry.name, is_control=False, scenario_json=json.dumps(plain_values(flown)),
            directory=directory, room="", tape=None, case_hash=name,
            sources=(case.path.absolute(),),
        )  # fmt: skip


def rows_of(family: str, cases: Sequence[LoadedScenario], entry: EntrySpec) -> list[Row]:
    """Return a row for the flight of a method in each case, in their order; see `CaseFlight.row`."""
    rooms = Rooms()
    return [CaseFlight(family=family, case=case, entry=entry).row(rooms) for case in cases]
