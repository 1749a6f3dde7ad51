"""Suite files: read with all problems reported at once, and written resolved into a folder that stands alone."""

import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.base.files import replace_file
from gslcosim.bench.cases.hashes import list_entry_files
from gslcosim.bench.cases.models import EntrySpec, ScenarioSpec, Suite
from gslcosim.scenario import load_scenario
from gslcosim.scenario.bundled import bundled_folder, bundled_scenarios
from gslcosim.scenario.loader import find_scenario
from gslcosim.scenario.problems import InvalidScenarioError
from gslcosim.scenario.serialization import dump_values
from gslcosim.scenario.spec_files import read_spec_file
from gslcosim.scenario.suggestions import did_you_mean

SUITE_FILE = "suite.yaml"
_ENDINGS = (".yaml", ".yml")


@dataclass(frozen=True, kw_only=True)
class LoadedSuite:
    """A valid suite, where it came from, and the suites that it includes.

    `directory` is where its relative paths start; `shown_path` is how the user named the file.
    """

    suite: Suite
    path: Path
    directory: Path
    shown_path: str
    included: tuple["LoadedSuite", ...] = ()

    @property
    def demands_sandbox(self) -> bool:
        """True where agents of some or all cases must run in a sandbox."""
        return self.suite.sandbox == "required" or any(inner.demands_sandbox for inner in self.included)


def bundled_suites() -> dict[str, Path]:
    """Return the bundled suite files by name."""
    return {path.parent.name: path for path in sorted(bundled_folder("suites").glob(f"*/{SUITE_FILE}"))}


def load_suite(source: str | Path, *, seed: int | None = None) -> LoadedSuite:
    """Read and check a suite, with all that it includes.

    Args:
        source: A file, or the name of a bundled suite.
        seed: Replaces the suite's seed, and that of the suites it includes.

    Raises:
        ScenarioError: there is no such suite, or it has problems: all of them in one error.
    """
    return _load(source, seed, within=())


def find_suite(source: str | Path) -> Path:
    """Return the file of a suite that is named by path, or by name when it is bundled.

    Raises:
        ScenarioError: there is none.
    """
    path = Path(source)
    if path.is_dir() and (path / SUITE_FILE).is_file():
        return path / SUITE_FILE
    if path.is_file():
        return path
    bundled = bundled_suites()
    if str(source) in bundled:
        return bundled[str(source)]
    if path.suffix in _ENDINGS or len(path.parts) > 1:
        raise ScenarioError(f"{source}: expected a suite file, found none.")
    raise ScenarioError(
        f"{source}: expected a file or a bundled suite ({', '.join(bundled)}), found neither. "
        f"{did_you_mean(str(source), list(bundled))}".rstrip()
    )


def _load(source: str | Path, seed: int | None, within: tuple[Path, ...]) -> LoadedSuite:
    path = find_suite(source).resolve()
    if path in within:
        chain = " includes ".join(inner.parent.name for inner in (*within, path))
        raise ScenarioError(f"{source}: include: expected suites that do not include themselves, was {chain}.")
    shown_path = str(source) if Path(source).is_file() else str(path)
    suite = read_spec_file(path, Suite, shown_path=shown_path, keys="scenarios and entries")
    if seed is not None:
        suite = suite.model_copy(update={"seed": seed})
    included = tuple(_load(_beside(path, name), seed, (*within, path)) for name in suite.include)
    return LoadedSuite(suite=suite, path=path, directory=path.parent, shown_path=shown_path, included=included)


def _beside(path: Path, name: str) -> str | Path:
    beside = path.parent / name
    return beside if beside.exists() else name


SCENARIOS, AGENTS, SUITES = "scenarios", "agents", "suites"


def write_suite(loaded: LoadedSuite, folder: Path) -> None:
    """Write `suite.yaml` with all defaults filled in, and beside it whatever of its files is not bundled.

    A scenario that names files of its own, such as stored gas, is named by its absolute path instead.

    Args:
        loaded: The suite.
        folder: Where; it is made, and written over.

    Raises:
        UsageError: a folder is where `suite.yaml` has to be.
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
    if os.path.realpath(path) == str(loaded.path) or (path.is_file() and path.read_bytes() == text.encode()):
        return
    try:
        replace_file(folder, SUITE_FILE, text.encode())
    except IsADirectoryError as error:
        problem = f"{path}: expected a file, was a folder. Move it away, or choose another folder for results."
        raise UsageError(problem) from error


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
    kept = _copied(list_entry_files(entry, directory), folder, f"{AGENTS}/{entry.name}")
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
