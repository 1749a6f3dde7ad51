"""Hashes that identify a run: of the software, an entry's files, a case and a trial."""

import hashlib
import json
import sys
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gslcosim.base.code_identity import COMPUTING_PACKAGES, hash_result_code
from gslcosim.bench.cases.agent_setup import files_in_command, find_program
from gslcosim.bench.cases.models import EntrySpec
from gslcosim.methods.card import CARD_FILE
from gslcosim.scenario import Scenario
from gslcosim.scenario.serialization import plain_values

_HEAD_BYTES = 65_536
_DIGITS = 24


@cache
def software_hash() -> str:
    """Return what the package's own code and the packages that it computes with are."""
    digest = hashlib.blake2b(digest_size=_DIGITS // 2)
    digest.update(hash_result_code().encode())
    python = ".".join(str(part) for part in sys.version_info[:2])
    digest.update(json.dumps([python, *((name, version(name)) for name in COMPUTING_PACKAGES)]).encode())
    return digest.hexdigest()


def agent_hash(entry: EntrySpec, directory: Path) -> str:
    """Return what the program of an entry is: its file, and the files of Python and of cards beside it.

    A command that is found on the system's path counts by its name alone.

    Args:
        entry: The entry.
        directory: Where its relative paths start.
    """
    digest = hashlib.blake2b(digest_size=_DIGITS // 2)
    words = [entry.start.python or "", *(entry.start.command or ())]
    names = [Path(word).name if (directory / word).is_file() else word for word in words]
    digest.update(json.dumps(names).encode())
    for path in list_entry_files(entry, directory):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def list_entry_files(entry: EntrySpec, directory: Path) -> list[Path]:
    """Return the files that an entry's program is made of: those it names, and what Python and cards lie beside it."""
    named = {path.resolve() for path in files_in_command(entry, directory)}
    program = find_program(entry, directory)
    if program is not None:
        named.add(program.resolve())
        named |= {path.resolve() for path in list_program_files(program)}
    return sorted(named)


def list_program_files(program: Path) -> list[Path]:
    """Return the files of a program's folder that count as part of it: Python, arrays, and its card."""
    return sorted(path for pattern in ("*.py", "*.npz", CARD_FILE) for path in program.parent.glob(pattern))


def case_hash(scenario: Scenario, room: str, *, is_control: bool, repetition: int) -> str:
    """Return what decides a case and repetition apart from the entry: equal for all who meet the same."""
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
        entry: The entry's name.
        agent: The hash of its program.
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
    if scenario.gas.stored is not None:
        values["gas"]["playback"]["folder"] = folder_hash(Path(scenario.gas.stored.folder))
    for agent in values["agents"]:
        start = agent["start"]
        start.pop("python", None)
        start.pop("command", None)
    return values


@cache
def folder_hash(folder: Path) -> str:
    """Return what a folder or file of stored gas holds: names, sizes and the beginning of each file."""
    digest = hashlib.blake2b(digest_size=_DIGITS // 2)
    paths = [folder] if folder.is_file() else sorted(path for path in folder.rglob("*") if path.is_file())
    for path in paths:
        digest.update(f"{path.name}/{path.stat().st_size}".encode())
        with path.open("rb") as file:
            digest.update(file.read(_HEAD_BYTES))
    return digest.hexdigest()


def _hash(values: Any) -> str:
    text = json.dumps(values, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=_DIGITS // 2).hexdigest()
