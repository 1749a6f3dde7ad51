"""Suite files, read with all problems at once and written resolved, and hashes that identify a run."""

import hashlib
import json
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

from gslcosim.base.bundled import SUITE_FILE, bundled_families, bundled_scenarios, bundled_suites
from gslcosim.base.code_identity import COMPUTING_PACKAGES, hash_result_code
from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.base.files import list_files, read_regular_file, replace_file
from gslcosim.base.yaml_core import without_editor_header
from gslcosim.methods.card import CARD_FILE, SHARED_PARAMETERS
from gslcosim.scenario import Scenario, load_scenario
from gslcosim.scenario.checks.registry import find_problems
from gslcosim.scenario.problems import InvalidScenarioError, did_you_mean
from gslcosim.scenario.serialization import dump_values, plain_values, read_yaml
from gslcosim_bench.cases.agent_setup import files_in_command, find_program
from gslcosim_bench.cases.families import CaseFamily, find_family_beside
from gslcosim_bench.cases.models import EntrySpec, ScenarioSpec, Suite
from gslcosim_bench.cases.spec_files import find_scenario_beside, raise_located, read_spec_file
from gslcosim_bench.cases.submission_bundles import (
    copy_bundle_files,
    copy_shared_file,
    find_bundle_root,
    list_bundle_files,
)

_HEAD_BYTES = 65_536
_DIGITS = 24
_ENDINGS = (".yaml", ".yml")
SCENARIOS, FAMILIES, AGENTS, SUITES = "scenarios", "families", "agents", "suites"


@cache
def software_hash() -> str:
    """Return a hash of the package: its own code, parameters that cards share, and its numerical dependencies."""
    digest = hashlib.blake2b(digest_size=_DIGITS // 2)
    digest.update(hash_result_code().encode())
    for path in sorted(SHARED_PARAMETERS.glob("*.yaml")):
        digest.update(path.read_bytes())
    python = ".".join(str(part) for part in sys.version_info[:2])
    digest.update(json.dumps([python, *((name, version(name)) for name in COMPUTING_PACKAGES)]).encode())
    return digest.hexdigest()


def agent_hash(entry: EntrySpec, directory: Path) -> str:
    """Return a hash of an entry's program: its file, and the files of Python and of cards beside it.

    A command that is found on the system's path counts by its name alone.

    Args:
        directory: Where its relative paths start.
    """
    digest = hashlib.blake2b(digest_size=_DIGITS // 2)
    words = [entry.start.python or "", *(entry.start.command or ())]
    names = [Path(word).name if (directory / word).is_file() else word for word in words]
    digest.update(json.dumps(names).encode())
    root = _bundle_root(entry, directory)
    for path in list_entry_files(entry, directory):
        is_single = root is None or not path.is_relative_to(root)
        digest.update((path.name if is_single else path.relative_to(cast("Path", root)).as_posix()).encode())
        digest.update(without_editor_header(read_regular_file(path)))
    return digest.hexdigest()


def list_entry_files(entry: EntrySpec, directory: Path) -> list[Path]:
    """Return the files that an entry's program is made of: those it names, and what Python and cards lie beside it.

    Of a submission, all files that its bundle has.
    """
    named = {path.resolve() for path in files_in_command(entry, directory)}
    program = find_program(entry, directory)
    if (root := _bundle_root(entry, directory)) is not None:
        named |= {path.resolve() for path in list_bundle_files(root)}
    elif program is not None:
        named.add(program.resolve())
        named |= {path.resolve() for path in list_program_files(program)}
    return sorted(named)


def _bundle_root(entry: EntrySpec, directory: Path) -> Path | None:
    if entry.start.python is not None and not (directory / entry.start.python).is_file():
        return None
    program = find_program(entry, directory)
    return find_bundle_root(program) if program is not None else None


def list_program_files(program: Path) -> list[Path]:
    """Return the files of a program's folder that count as part of it: Python, arrays, and its card."""
    found = (path for pattern in ("*.py", "*.npz", CARD_FILE) for path in program.parent.glob(pattern))
    return sorted(path for path in found if path.is_file())


def case_hash(scenario: Scenario, room: str, *, is_control: bool, repetition: int) -> str:
    """Return a hash of a case and repetition, without the entry: equal for all who meet the same."""
    values = _without_paths(plain_values(scenario), scenario)
    vehicle = values.pop("agents")[0]["vehicle"]
    for other in ("recording", "channels"):
        values.pop(other, None)
    return _hash([values, vehicle, room, is_control, repetition])


def trial_id(scenario: Scenario, room: str, entry: str, agent: str) -> str:
    """Return the id of a trial, the same on every machine.

    Args:
        scenario: As resolved.
        room: The key of its environment, see `get_environment_key`.
    """
    values = _without_paths(plain_values(scenario), scenario)
    values.pop("recording", None)
    return _hash([values, room, entry, agent, software_hash()])


# Paths are no content: rooms, gas and programs are identified by their own hashes.
def _without_paths(values: dict[str, Any], scenario: Scenario) -> dict[str, Any]:
    values.pop("name")
    environment = values["environment"]
    if scenario.environment.layout is None:
        values["environment"] = sorted(environment)
    if scenario.wind.file is not None:
        values["wind"]["solver"] = "file"
    if scenario.gas.stored_folder is not None:
        values["gas"]["playback"]["folder"] = folder_hash(Path(scenario.gas.stored_folder))
    for agent in values["agents"]:
        start = agent["start"]
        start.pop("python", None)
        start.pop("command", None)
    return values


@cache
def folder_hash(folder: Path) -> str:
    """Return a hash of a folder or file of stored gas: names, sizes and the beginning of each file."""
    digest = hashlib.blake2b(digest_size=_DIGITS // 2)
    paths = [folder] if folder.is_file() else list_files(folder)
    for path in paths:
        digest.update(f"{path.name}/{path.stat().st_size}".encode())
        with path.open("rb") as file:
            digest.update(file.read(_HEAD_BYTES))
    return digest.hexdigest()


def _hash(values: Any) -> str:
    text = json.dumps(values, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=_DIGITS // 2).hexdigest()


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


def load_suite(
    source: str | Path,
    *,
    seed: int | None = None,
    commitment: str | None = None,
    is_flown: bool = False,
    needs_seed: bool = True,
) -> LoadedSuite:
    """Read and check a suite, with all that it includes.

    Args:
        seed: Replaces the suite's seed, and that of the suites it includes.
        commitment: That of the seed, where it is secret: `write_suite` then writes it in place of the seed.
        is_flown: Whether its scenarios and the programs of its entries have to be there.
        needs_seed: Whether a suite of sealed results is refused without its seed.

    Raises:
        ScenarioError: there is no such suite, or it has problems: all of them in one error.
    """
    sealed = _SealedSeed(seed=seed, commitment=commitment, is_needed=needs_seed)
    return _load(source, sealed, within=(), is_flown=is_flown)


@dataclass(frozen=True, kw_only=True)
class _SealedSeed:
    seed: int | None
    commitment: str | None
    is_needed: bool

    def applied_to(self, suite: Suite, shown_path: str) -> Suite:
        if suite.sealed is not None and self.is_needed and self.commitment != suite.sealed:
            found = "another one" if self.commitment else "none"
            raise ScenarioError(
                f"{shown_path}: sealed: expected the secret of commitment {suite.sealed[:16]}, was {found}. "
                "Give it with --sealed SUITE.secret.json: its organiser has it, and publishes it in the end."
            )
        if self.seed is None:
            return suite
        return suite.model_copy(update={"seed": self.seed, "sealed": self.commitment})


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


def _load(source: str | Path, seed: _SealedSeed, within: tuple[Path, ...], *, is_flown: bool) -> LoadedSuite:
    path = find_suite(source).resolve()
    if path in within:
        chain = " includes ".join(inner.parent.name for inner in (*within, path))
        raise ScenarioError(f"{source}: include: expected suites that do not include themselves, was {chain}.")
    shown_path = str(source) if Path(source).is_file() else str(path)
    suite = read_spec_file(path, Suite, shown_path=shown_path, keys="scenarios and entries")
    if is_flown:
        raise_located(find_problems("suite", suite, path.parent), path, shown_path=shown_path)
    suite = seed.applied_to(suite, shown_path)
    inner = (_load(_beside(path, name), seed, (*within, path), is_flown=is_flown) for name in suite.include)
    return LoadedSuite(suite=suite, path=path, directory=path.parent, shown_path=shown_path, included=tuple(inner))


def _beside(path: Path, name: str) -> str | Path:
    beside = path.parent / name
    return beside if beside.exists() else name


def write_suite(loaded: LoadedSuite, folder: Path) -> None:
    """Write `suite.yaml` with all defaults filled in, and beside it whatever of its files is not bundled.

    The seed of a sealed suite is not written.

    A scenario that names files of its own, such as stored gas, is named by its absolute path instead.

    Args:
        folder: Where; it is made, and written over.

    Raises:
        UsageError: a folder is where `suite.yaml` has to be.
    """
    folder.mkdir(parents=True, exist_ok=True)
    values: dict[str, Any] = json.loads(loaded.suite.model_dump_json(by_alias=True, exclude_none=True))
    if loaded.suite.sealed is not None:
        values.pop("seed")
    # A null that a suite sets takes a value away, and is no default that could be left out.
    values["set"] = loaded.suite.set
    for spec, scenario in zip(loaded.suite.scenarios, values["scenarios"], strict=True):
        scenario["set"] = spec.set
        scenario["source"] = _kept_scenario(spec, loaded, folder)
    for spec, entry in zip(loaded.suite.entries, values["entries"], strict=True):
        entry["start"] = _kept_program(spec, loaded.directory, folder)
    for i, inner in enumerate(loaded.included):
        place = f"{SUITES}/{inner.suite.name}"
        write_suite(inner, folder / place)
        values["include"][i] = place
    text = dump_values(values)
    path = folder / SUITE_FILE
    if os.path.realpath(path) == str(loaded.path) or (path.is_file() and read_regular_file(path) == text.encode()):
        return
    try:
        replace_file(folder, SUITE_FILE, text.encode())
    except IsADirectoryError as error:
        problem = f"{path}: expected a file, was a folder. Move it away, or choose another folder for results."
        raise UsageError(problem) from error


def _kept_scenario(spec: ScenarioSpec, loaded: LoadedSuite, folder: Path) -> str:
    if spec.split is not None:
        return _kept_family(find_family_beside(spec.source, loaded.directory), folder)
    path = find_scenario_beside(spec.source, loaded.directory)
    if bundled_scenarios().get(path.stem) == path:
        return path.stem
    if _names_files(path):
        return str(path.resolve())
    return _copied([path], folder, SCENARIOS)[path.resolve()]


def _kept_family(family: CaseFamily, folder: Path) -> str:
    if bundled_families().get(family.path.parent.name) == family.path:
        return family.path.parent.name
    beside = family.directory / family.spec.scenario
    if beside.is_file() and (beside.resolve().parent != family.directory or _names_files(beside)):
        return str(family.path.resolve())
    files = [family.path, *([beside] if beside.is_file() else [])]
    return _copied(files, folder, f"{FAMILIES}/{family.name}")[family.path.resolve()]


def _names_files(path: Path) -> bool:
    try:
        scenario = load_scenario(path).scenario
    except InvalidScenarioError:
        # What the suite sets, or a room in which places are drawn, makes it whole.
        block = read_yaml(read_regular_file(path).decode(), source=path.name).block or {}
        environment, wind, gas = (block.get(key) or {} for key in ("environment", "wind", "gas"))
        if not all(isinstance(part, Mapping) for part in (environment, wind, gas)):
            return True
        solver = wind.get("solver", "auto")
        return not environment.keys() <= {"layout", "doors"} or not isinstance(solver, str) or "playback" in gas
    return bool(scenario.environment.inputs or scenario.wind.file or scenario.gas.stored_folder)


def _kept_program(entry: EntrySpec, directory: Path, folder: Path) -> dict[str, Any]:
    start: dict[str, Any] = json.loads(entry.start.model_dump_json(exclude_none=True))
    is_bundled = entry.start.python is not None and not (directory / entry.start.python).is_file()
    if is_bundled:
        return start
    files, into, root = list_entry_files(entry, directory), f"{AGENTS}/{entry.name}", _bundle_root(entry, directory)
    if root is not None and folder.resolve().is_relative_to(root):
        # What was written of another entry just now.
        files = [path for path in files if not path.is_relative_to(folder.resolve())]
    kept = _copied([path for path in files if root is None or not path.is_relative_to(root)], folder, into)
    if root is not None:
        kept |= copy_bundle_files([path for path in files if path.is_relative_to(root)], root, folder, into)
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
        copy_shared_file(path, target)
        kept[path.resolve()] = f"{into}/{path.name}"
    return kept
