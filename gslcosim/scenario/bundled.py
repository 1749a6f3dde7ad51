"""Bundled scenarios and agents, found by name without importing them."""

import importlib.util
from pathlib import Path

SCENARIOS_PACKAGE = "gslcosim_scenarios"
AGENTS_PACKAGE = "gslcosim_agents"
AGENT_FILE = "agent.py"


def bundled_scenarios() -> dict[str, Path]:
    """Return the bundled scenario files by name."""
    return {path.stem: path for path in sorted(_folder_of(SCENARIOS_PACKAGE).glob("*.yaml"))}


def bundled_agents() -> dict[str, Path]:
    """Return the program of each bundled Python agent by name: `agents/<name>/agent.py`."""
    return {path.parent.name: path for path in sorted(_folder_of(AGENTS_PACKAGE).glob(f"*/{AGENT_FILE}"))}


def bundled_folder(name: str) -> Path:
    """Return a folder beside the bundled scenarios, for example of suites."""
    return _folder_of(SCENARIOS_PACKAGE) / name


def _folder_of(package: str) -> Path:
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError(f"{package}: expected beside gslcosim, found none. Install gslcosim again.")
    return Path(next(iter(spec.submodule_search_locations)))
