"""Setup of a run: all that its cores are built from, and the file by which services read it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gslcosim.contract.participant import Episode
from gslcosim.environment.model import Environment, EnvironmentVariant
from gslcosim.environment.store import load_environment
from gslcosim.runtime.agents.validator import RecordedCommands
from gslcosim.runtime.replay.snapshot import Snapshot
from gslcosim.runtime.run_dir import RunDir
from gslcosim.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class RunSetup:
    """Input that every core of a run is built from.

    `directory` is where relative paths of agents and participants start; `past` has the commands that count whatever
    agents answer, where the run is a fork; services do not need it.
    `paced_from_tick` is the first tick that keeps the scenario's pace; absent: none does, as in a replay.
    `snapshot` is where the run goes on; absent: it begins at tick 0. `later_rooms` are the folders of what events make
    of `environment`, by situation. `sources` are the files from which the scenario was resolved, its own among them.
    """

    run_dir: RunDir
    scenario: Scenario
    environment_dir: Path
    environment: Environment
    directory: Path | None = None
    past: RecordedCommands | None = None
    paced_from_tick: int | None = None
    snapshot: Snapshot | None = None
    later_rooms: Mapping[EnvironmentVariant, Path] = field(default_factory=dict[EnvironmentVariant, Path])
    sources: tuple[Path, ...] = ()

    @property
    def episode(self) -> Episode:
        """The episode of the run."""
        return Episode(seed=self.scenario.seed)

    def save(self) -> None:
        """Write `setup.json` beside the resolved scenario, for the services of the run."""
        places: dict[str, Any] = {"environment": str(self.environment_dir)}
        if self.later_rooms:
            rooms = self.later_rooms.items()
            places["later_rooms"] = [{**variant._asdict(), "folder": str(folder)} for variant, folder in rooms]
        if self.sources:
            places["sources"] = [str(path) for path in self.sources]
        if self.directory is not None:
            places["directory"] = str(self.directory)
        if self.paced_from_tick is not None:
            places["paced_from_tick"] = self.paced_from_tick
        if self.snapshot is not None:
            places["snapshot"] = str(self.snapshot.folder.absolute())
        self.run_dir.replace(self.run_dir.setup.name, json.dumps(places) + "\n")

    @classmethod
    def load(cls, path: Path) -> "RunSetup":
        """Read what `save` wrote into a run directory."""
        run_dir = RunDir(path)
        scenario = run_dir.load_scenario()
        saved = run_dir.load_setup()
        environment_dir = Path(saved["environment"])
        environment = load_environment(environment_dir)
        rooms = saved.get("later_rooms", ())
        later_rooms = {EnvironmentVariant.from_values(each): Path(each["folder"]) for each in rooms}
        if later_rooms:
            from gslcosim.environment.generation.cache import with_variants

            environment = with_variants(environment, later_rooms)
        return cls(
            run_dir=run_dir,
            scenario=scenario,
            environment_dir=environment_dir,
            environment=environment,
            later_rooms=later_rooms,
            sources=tuple(Path(path) for path in saved.get("sources", ())),
            paced_from_tick=saved.get("paced_from_tick"),
            directory=Path(saved["directory"]) if "directory" in saved else None,
            snapshot=Snapshot.at(Path(saved["snapshot"]), scenario) if "snapshot" in saved else None,
        )
