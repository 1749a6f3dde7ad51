"""A suite as resolved, in a folder that stands alone: with the suites, scenarios and programs that it names."""

import json
import shutil
from pathlib import Path
from typing import Any

from gslcosim.benchmark.suite.identity import files_of
from gslcosim.benchmark.suite.loading import SUITE_FILE, LoadedSuite
from gslcosim.benchmark.suite.models import EntrySpec, ScenarioSpec
from gslcosim.scenario import load_scenario
from gslcosim.scenario.bundled import bundled_scenarios
from gslcosim.scenario.dumping import dump_values
from gslcosim.scenario.loading import find_scenario
from gslcosim.scenario.problems import InvalidScenarioError

SCENARIOS, AGENTS, SUITES = "scenarios", "agents", "suites"


def write_suite(loaded: LoadedSuite, folder: Path) -> None:
    """Write `suite.yaml` with all defaults filled in, and beside it whatever of its files is not bundled.

    A scenario that names files of its own, such as stored gas, is named by its absolute path instead.

    Args:
        loaded: The suite.
        folder: Where; it is made, and written over.
    """
    folder.mkdir(parents=True, exist_ok=True)
    values: dict[str, Any] = json.loads(loaded.suite.model_dump_json(by_alias=True, exclude_none=True))
    for spec, scenario in zip(loaded.suite.scenarios, values["scenarios"], strict=True):
        scenario["source"] = _kept_scenario(spec, loaded, folder)
    for spec, entry in zip(loaded.suite.entries, values["entries"], strict=True):
        entry["start"] = _kept_program(spec, loaded.directory, folder)
    for i, inner in enumerate(loaded.included):
        place = f"{SUITES}/{inner.suite.name}"
        write_suite(inner, folder / place)
        values["include"][i] = place
    text = dump_values(values)
    path = folder / SUITE_FILE
    if path.resolve() != loaded.path and not (path.is_file() and path.read_text(encoding="utf-8") == text):
        path.write_text(text, encoding="utf-8")


def _kept_scenario(spec: ScenarioSpec, loaded: LoadedSuite, folder: Path) -> str:
    beside = loaded.directory / spec.source
    path = find_scenario(beside if beside.is_file() else spec.source)
    if bundled_scenarios().get(path.stem) == path:
        return path.stem
    if _names_files(path):
        return str(path.resolve())
    return _copied([path], folder, SCENARIOS)[path.resolve()]


def _names_files(path: Path) -> bool:
    try:
        scenario = load_scenario(path).scenario
    except InvalidScenarioError:
        return True  # what the suite sets makes it whole; where it stands it can be read
    environment = scenario.environment
    has_files = environment.folder_key is not None or environment.geometry is not None
    return has_files or scenario.wind.file is not None or scenario.gas.stored is not None


def _kept_program(entry: EntrySpec, directory: Path, folder: Path) -> dict[str, Any]:
    start: dict[str, Any] = json.loads(entry.start.model_dump_json(exclude_none=True))
    is_bundled = entry.start.python is not None and not (directory / entry.start.python).is_file()
    if is_bundled:
        return start
    kept = _copied(files_of(entry, directory), folder, f"{AGENTS}/{entry.name}")
    if entry.start.python is not None:
        start["python"] = kept[(directory / entry.start.python).resolve()]
    else:
        start["command"] = [kept.get((directory / word).resolve(), word) for word in entry.start.command or ()]
    return start


def _copied(paths: list[Path], folder: Path, into: str) -> dict[Path, str]:
    (folder / into).mkdir(parents=True, exist_ok=True)
    kept: dict[Path, str] = {}
    for path in paths:
        target = folder / into / path.name
        if target.resolve() != path.resolve():
            shutil.copy(path, target)
        kept[path.resolve()] = f"{into}/{path.name}"
    return kept
