"""Files and folders from which a scenario is resolved: who reads them knows the whole scenario."""

from pathlib import Path

from gslcosim.scenario.models.scenario import Scenario


def list_input_files(scenario: Scenario, directory: Path) -> list[Path]:
    """Return what a scenario names beside its own file: the room's folder or geometry, its wind, and stored gas.

    Args:
        scenario: The scenario.
        directory: Where its relative paths start.
    """
    environment, gas = scenario.environment, scenario.gas.stored
    named = [getattr(environment, environment.folder_key)] if environment.folder_key is not None else []
    named += environment.geometry.files if environment.geometry is not None else ()
    named += [name for name in (scenario.wind.file, gas.folder if gas is not None else None) if name is not None]
    return [(directory / Path(name).expanduser()).absolute() for name in named]
