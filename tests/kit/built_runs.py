"""Runs that tests set up and step themselves."""

from pathlib import Path
from typing import Any

from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.store import load_environment
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario.loader import LoadedScenario


def build_setup(loaded: LoadedScenario, folder: Path, *, run_dir: RunDir | None = None, **fields: Any) -> RunSetup:
    """Return what services of a run are made from; its own folder is a new one in `folder`, unless one is given."""
    environment_dir = prepare_environment(loaded.scenario, scenario_dir=loaded.directory)
    whole = {
        "run_dir": run_dir or RunDir.create(folder, name="run", seed=1),
        "scenario": loaded.scenario,
        "environment_dir": environment_dir,
        "environment": load_environment(environment_dir),
    }
    return RunSetup(**{**whole, **fields})
