"""What every core of a run is built from, and how the services of a run come by it."""

import json
from dataclasses import dataclass
from pathlib import Path

from gslcosim.contract.participant import Episode
from gslcosim.environment.model import Environment
from gslcosim.environment.store import load_environment
from gslcosim.runtime.agents.past import Past
from gslcosim.runtime.run_dir import RunDir
from gslcosim.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What every core of a run is built from.

    `directory` is where relative paths of agents start; `past` has the commands that count whatever agents answer,
    where the run is a fork. Services need neither.
    """

    run_dir: RunDir
    scenario: Scenario
    environment_dir: Path
    environment: Environment
    directory: Path | None = None
    past: Past | None = None

    @property
    def episode(self) -> Episode:
        """The episode that the run flies."""
        return Episode(seed=self.scenario.seed)

    def save(self) -> None:
        """Write `setup.json` beside the resolved scenario, for the services of the run."""
        places = {"environment": str(self.environment_dir)}
        if self.directory is not None:
            places["directory"] = str(self.directory)
        self.run_dir.replace(self.run_dir.setup.name, json.dumps(places) + "\n")

    @classmethod
    def load(cls, path: Path) -> "Setup":
        """Read what `save` wrote into a run directory."""
        run_dir = RunDir(path)
        scenario = run_dir.load_scenario()
        environment_dir = Path(json.loads(run_dir.setup.read_text())["environment"])
        return cls(
            run_dir=run_dir,
            scenario=scenario,
            environment_dir=environment_dir,
            environment=load_environment(environment_dir),
        )
