"""Bundled scenarios, suites, families, train files, agents and contract, found by name without importing them."""

import importlib.util
from functools import cache
from pathlib import Path

from gslcosim.base.extensions import AGENTS_GROUP, list_registered

SCENARIOS_PACKAGE = "gslcosim_scenarios"
AGENTS_PACKAGE = "gslcosim_agents"
AGENT_FILE = "agent.py"
CARD_FILE = "method.yaml"
# It names the folder around it as a bundle: a program with all that it needs, packed, hashed and moved as one.
SUBMISSION_FILE = "submission.yaml"
# Endings of what `start.python` takes beside names: a file of Python, and a card that names its program.
PROGRAM_ENDINGS = (".py", CARD_FILE)
SUITE_FILE = "suite.yaml"
FAMILY_FILE = "family.yaml"


def bundled_scenarios() -> dict[str, Path]:
    """Return the bundled scenario files by name."""
    return {path.stem: path for path in sorted(_folder_of(SCENARIOS_PACKAGE).glob("*.yaml"))}


def bundled_suites() -> dict[str, Path]:
    """Return the bundled suite files by name."""
    return {path.parent.name: path for path in sorted(bundled_folder("suites").glob(f"*/{SUITE_FILE}"))}


def bundled_families() -> dict[str, Path]:
    """Return the bundled family files by name."""
    return {path.parent.name: path for path in sorted(bundled_folder("families").glob(f"*/{FAMILY_FILE}"))}


def bundled_train_files() -> dict[str, Path]:
    """Return the train files beside the bundled families by name."""
    folder = bundled_folder("families")
    return {path.stem.removesuffix(".train"): path for path in sorted(folder.glob("*/*.train.yaml"))}


def bundled_agents() -> dict[str, Path]:
    """Return the program of each bundled Python agent, and of extensions' agents: `agent.py`, or else its card."""
    folders, files = _list_agent_folders(), (CARD_FILE, AGENT_FILE)
    programs = {path.parent.name: path for folder in folders for file in files for path in folder.glob(f"*/{file}")}
    return dict(sorted(programs.items()))


def find_bundled_agent(name: str) -> Path | None:
    """Return the program of the bundled Python agent of a name, from the folders of `bundled_agents`, or None.

    No folder is listed: suites look up their methods thousands of times.
    """
    if name in ("", "..") or Path(name).name != name:
        return None
    folders = reversed(_list_agent_folders())
    programs = (folder / name / file for folder in folders for file in (AGENT_FILE, CARD_FILE))
    return next((program for program in programs if program.is_file()), None)


def bundled_schemas() -> dict[str, Path]:
    """Return the JSON Schemas of the files that users write, by the kind in their `schema`, such as `suite`.

    Each lies in the package of the bundled files that refer to it by a relative path, which holds in any installation.
    """
    schemas = {
        kind: bundled_folder("schemas") / f"{kind}.schema.json" for kind in ("scenario", "suite", "family", "train")
    }
    return {**schemas, "method": _folder_of(AGENTS_PACKAGE) / "schemas" / "method.schema.json"}


def bundled_folder(name: str) -> Path:
    """Return a folder beside the bundled scenarios, for example of suites."""
    return _folder_of(SCENARIOS_PACKAGE) / name


def bundled_contract() -> Path:
    """Return the folder of the published contract: schemas, AsyncAPI documents and golden vectors."""
    return _folder_of(AGENTS_PACKAGE) / "contract"


# Packages of extensions by their entry points, and last the core's own, whose agents take precedence.
@cache
def _list_agent_folders() -> tuple[Path, ...]:
    return tuple(_folder_of(package) for package in (*(p.value for p in list_registered(AGENTS_GROUP)), AGENTS_PACKAGE))


def _folder_of(package: str) -> Path:
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError(f"{package}: expected a folder of files, found none. Install its package again.")
    return Path(next(iter(spec.submodule_search_locations)))
