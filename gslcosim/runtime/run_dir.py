"""Run directory: everything a run leaves behind, in one place, with notes of the machine and versions of packages."""

import contextlib
import hashlib
import importlib.metadata
import json
import os
import platform
import re
import secrets
import subprocess
import sys
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Required, TypedDict, TypeVar

import msgspec
import yaml
from pydantic import ValidationError

import gslcosim
from gslcosim.base.checksums import check_files, write_checksums
from gslcosim.base.code_identity import COMPUTING_PACKAGES
from gslcosim.base.errors import (
    RunFolderError,
    build_machine_error,
    describe_os_error,
    find_remedy,
    format_machine_error,
)
from gslcosim.base.files import append_bytes, open_for_writing, read_regular_file, replace_file, write_all
from gslcosim.base.untrusted_input import (
    FROM_A_COPY,
    MalformedFileError,
    describe_validation_errors,
    parse_json,
    read_json,
)
from gslcosim.base.yaml_core import BoundedLoader
from gslcosim.contract import codec
from gslcosim.contract.messages import Command
from gslcosim.contract.version import CONTRACT_HASH
from gslcosim.environment.model import VariantValues
from gslcosim.scenario.models.scenario import Processes, Scenario

T = TypeVar("T")

LOCK_FILE = Path(__file__).resolve().parents[2] / "requirements.lock"
# Every new environment has its own versions of these packages.
_INSTALLERS = ("pip", "setuptools", "wheel")
_PIN = re.compile(r"^([A-Za-z0-9._-]+)==([^\s;]+)", re.MULTILINE)
_INSTALLED = re.compile(r"^([A-Za-z0-9._]+)-([^-]+)\.dist-info$")
NAME = "machine.log"
_MAX_BYTES = 1_000_000_000
# Space kept free for the result: if the disk fills up during the run, the result can still be written.
RESERVE_FILE = ".reserve"
INPUTS_FILE = "inputs.log"
# Files that are read back after the end of a run.
_CHECKED_FILES = (
    "scenario.yaml", "setup.json", "manifest.json", "digest.json", INPUTS_FILE, "result.json", "recording.rrd",
)  # fmt: skip
RESERVE_BYTES = 32 * 1024
# Packages that compute a run, and those that carry its messages and record it.
MANIFEST_PACKAGES = (*COMPUTING_PACKAGES, "eclipse-zenoh", "rerun-sdk", "pyyaml")
# `result.json` has a few kB for each agent; a scenario as resolved has all defaults.
_MAX_SCENARIO_BYTES = 20_000_000
PathText = Annotated[str, msgspec.Meta(pattern="^[^\\x00]+$", max_length=4000)]


def installed_versions() -> dict[str, str]:
    """Return the version of each installed package by its normalised name; the first on the path counts, as in imports.

    The names of folders say all of it: reading the files in them takes longer than a run's start should.
    """
    versions: dict[str, str] = {}
    for place in sys.path:
        try:
            names = [entry.name for entry in os.scandir(place or ".")]
        except OSError:
            continue
        for match in filter(None, map(_INSTALLED.match, names)):
            versions.setdefault(_normalised(match[1]), match[2])
    return versions


def versions_hash(versions: Mapping[str, str]) -> str:
    """Return the SHA-256 of names with versions, in the order of the names."""
    lines = "".join(f"{name}=={version}\n" for name, version in sorted(versions.items()))
    return hashlib.sha256(lines.encode()).hexdigest()


def compare_with_lock(versions: Mapping[str, str], file: Path = LOCK_FILE) -> dict[str, Any] | None:
    """Return the hash of a lock file and the installed packages whose version it does not name; None without the file.

    Installed packages that the file does not name do not count, nor installers of packages, which are in no run.
    """
    try:
        content = file.read_bytes()
    except OSError:
        return None
    pins: dict[str, set[str]] = {}
    for name, version in _PIN.findall(content.decode(errors="replace")):
        pins.setdefault(_normalised(name), set()).add(version)
    differing = sorted(
        name
        for name, allowed in pins.items()
        if name not in _INSTALLERS and name in versions and versions[name] not in allowed
    )
    return {"sha256": hashlib.sha256(content).hexdigest(), "differing": differing}


def _normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


class _Note(TypedDict, total=False):
    tick: Annotated[int, msgspec.Meta(ge=-1, lt=1 << 62)]
    agent: str
    decided_ms: float
    participant: str
    fault: str
    sandboxes: dict[str, str]


class MachineLog:
    """Writer of notes as they come, a line of JSON each; if that fails, a run goes on without them.

    Args:
        folder: The run's; absent: nothing is written.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._fd: int | None = None

    def decided(self, agent: str, tick: int, taken_s: float) -> None:
        """Note how long an agent has taken for its answer to the observation of a tick, by the clock [s]."""
        self.write({"agent": agent, "tick": tick, "decided_ms": round(taken_s * 1e3, 4)})

    def failed(self, participant: str, tick: int, text: str) -> None:
        """Note a fault."""
        self.write({"participant": participant, "tick": tick, "fault": text})

    def close(self) -> None:
        """Release the file."""
        if self._fd is not None:
            os.close(self._fd)
        self._fd = self._folder = None

    def write(self, note: Mapping[str, Any]) -> None:
        """Add a note."""
        if self._folder is None:
            return
        try:
            if self._fd is None:
                self._fd = open_for_writing(self._folder, NAME, is_appended=True)
            write_all(self._fd, (json.dumps(note) + "\n").encode())
        except OSError:
            with contextlib.suppress(OSError):
                self.close()
            self._folder = None


def note_sandboxes(folder: Path, sandboxes: Mapping[str, str]) -> None:
    """Note in the folder of a run the sandbox of each agent's and participant's process."""
    log = MachineLog(folder)
    log.write({"sandboxes": dict(sandboxes)})
    log.close()


@dataclass(frozen=True, kw_only=True)
class MachineNotes:
    """Notes read back: by agent (tick, ms) of each decision, (tick, participant, text) of each fault, and sandboxes."""

    decisions_ms: Mapping[str, Sequence[tuple[int, float]]] = field(default_factory=dict[str, list[tuple[int, float]]])
    faults: Sequence[tuple[int, str, str]] = ()
    sandboxes: Mapping[str, str] = field(default_factory=dict[str, str])


def read_machine_notes(folder: Path) -> MachineNotes:
    """Return the notes in the folder of a run: none if there are none, or if the file is elsewhere."""
    try:
        lines = read_regular_file(folder / NAME, max_bytes=_MAX_BYTES).splitlines()
    except OSError:
        return MachineNotes()
    decisions: dict[str, list[tuple[int, float]]] = {}
    faults: list[tuple[int, str, str]] = []
    sandboxes: dict[str, str] = {}
    for line in lines:
        # In a file that was cut off, or changed by an agent, only lines in the format of notes count.
        with contextlib.suppress(MalformedFileError):
            note = parse_json(line, _Note, place=NAME)
            tick = note.get("tick", 0)
            if "decided_ms" in note:
                decisions.setdefault(note.get("agent", ""), []).append((tick, note["decided_ms"]))
            elif "fault" in note:
                faults.append((tick, note.get("participant", ""), note["fault"]))
            else:
                sandboxes |= note.get("sandboxes", {})
    return MachineNotes(decisions_ms=decisions, faults=sorted(faults), sandboxes=sandboxes)


class ForkOrigin(TypedDict):
    """The run from which a run was forked, and the tick of the fork."""

    run: str
    tick: int


class SoftwareLock(TypedDict):
    """Hash of the lock file, and the installed packages whose versions differ from it."""

    sha256: str
    differing: list[str]


class RunManifest(TypedDict, total=False):
    """Manifest of a run, as far as it is read; what another version has not written may be missing."""

    run_id: str
    seed: int
    environment_hash: str
    contract_hash: str
    gslcosim: str
    git: str | None
    lock: SoftwareLock | None
    installed_sha256: str
    fork_of: ForkOrigin
    imported_from: object


class AgentResult(TypedDict, total=False):
    """Figures of an agent in `result.json`, as far as they are read."""

    name: Required[str]
    outcome: Required[str]
    time_to_source_s: float | None
    path_length_m: Required[float]
    final_distance_m: Required[float]


class RunResult(TypedDict, total=False):
    """Result of a run, as far as it is read."""

    end_reason: Required[str]
    sim_time_s: float
    ticks: int
    digest: str | None
    agents: list[AgentResult]


class VariantEnvironment(VariantValues):
    """A room that events make, in `setup.json`."""

    folder: PathText


class RecordedSetup(TypedDict, total=False):
    """Setup of a run, as far as it is read."""

    environment: Required[PathText]
    directory: PathText
    later_rooms: list[VariantEnvironment]
    paced_from_tick: int | None
    snapshot: PathText


@dataclass(frozen=True)
class RunDir:
    """Paths and writers of one run directory.

    Agents of the same user can write there too: nothing is written through a link, and what is read by others is
    replaced at once.
    """

    path: Path

    @classmethod
    def create(cls, runs_dir: Path, *, name: str, seed: int) -> "RunDir":
        """Make a new directory that no other run has, however many start at once."""
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
        try:
            while True:
                path = runs_dir / f"{name}-seed{seed}-{stamp}-{secrets.token_hex(3)}"
                try:
                    path.mkdir(parents=True)
                except FileExistsError:
                    # Unless the folder of all runs is the obstacle.
                    if not os.path.lexists(path):
                        raise
                    continue
                (path / "logs").mkdir()
                run_dir = cls(path)
                run_dir._reserve()
                return run_dir
        except OSError as error:
            remedy = f"{find_remedy(error)} --runs-dir chooses another."
            raise build_machine_error(
                error, "runs directory", "a folder that can be written", path=runs_dir, remedy=remedy
            ) from error

    @property
    def run_id(self) -> str:
        """The name of the run."""
        return self.path.name

    @property
    def scenario(self) -> Path:
        """The scenario as resolved."""
        return self.path / "scenario.yaml"

    @property
    def recording(self) -> Path:
        """The Rerun recording."""
        return self.path / "recording.rrd"

    @property
    def digest(self) -> Path:
        """The digests of all ports."""
        return self.path / "digest.json"

    @property
    def setup(self) -> Path:
        """Setup that a service needs to build its core; see `gslcosim.runtime.setup`."""
        return self.path / "setup.json"

    @property
    def inputs(self) -> Path:
        """The commands that took effect, one JSON object a line."""
        return self.path / INPUTS_FILE

    def load_scenario(self) -> Scenario:
        """Read the scenario as resolved; its agents' relative paths start elsewhere."""
        place = f"{self.run_id}/{self.scenario.name}"
        try:
            text = read_regular_file(self.scenario, max_bytes=_MAX_SCENARIO_BYTES).decode()
            scenario = Scenario.model_validate(yaml.load(text, Loader=BoundedLoader))
        except (OSError, ValueError, yaml.YAMLError) as error:
            raise MalformedFileError(
                f"{place}: expected the scenario as resolved, was {_why_no_scenario(error)}. {FROM_A_COPY}\n"
                f"File: {self.scenario}"
            ) from error
        check_files(self.path, self.scenario.name)
        return scenario

    def load_manifest(self) -> RunManifest:
        """Read `manifest.json`; its versions are read before anything is compared with checksums."""
        return read_json(self.path / "manifest.json", RunManifest)

    def load_result(self) -> RunResult:
        """Read `result.json`."""
        return self._read("result.json", RunResult)

    def load_setup(self) -> RecordedSetup:
        """Read `setup.json`."""
        return self._read(self.setup.name, RecordedSetup)

    # An error in the content is more exact than a changed checksum.
    def _read(self, name: str, kind: type[T]) -> T:
        content = read_json(self.path / name, kind)
        check_files(self.path, name)
        return content

    def log(self, participant: str) -> Path:
        """Return the log file of a participant."""
        return self.path / "logs" / f"{participant}.log"

    def log_tail(self, participant: str, n_lines: int = 5) -> str:
        """Return the last lines of a participant's log, each shortened; empty when there are none."""
        try:
            lines = self.log(participant).read_text(errors="replace").splitlines()
        except OSError:
            return ""
        return "\n".join(line[:300] for line in lines[-n_lines:])

    def save_manifest(
        self,
        *,
        seed: int,
        environment_hash: str,
        processes: Processes,
        origin: Mapping[str, Any] | None = None,
        programs: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        """Write `manifest.json`: all that the determinism contract depends on, and `origin`, the run it repeats.

        `programs` are the files of participants' programs with their hashes, by participant.
        """
        versions = installed_versions()
        manifest = {
            "run_id": self.run_id,
            "seed": seed,
            "processes": processes,
            **(origin or {}),
            "environment_hash": environment_hash,
            **({"participants": programs} if programs else {}),
            "scenario_sha256": hashlib.sha256(self.scenario.read_bytes()).hexdigest(),
            "contract_hash": CONTRACT_HASH,
            "gslcosim": gslcosim.__version__,
            "git": _read_git_revision(),
            "python": sys.version.split()[0],
            "packages": {name: get_package_version(name) for name in MANIFEST_PACKAGES},
            "installed_sha256": versions_hash(versions),
            "lock": compare_with_lock(versions),
            "platform": platform.platform(),
            "cpu_flags": read_cpu_flags(),
        }
        self.replace("manifest.json", _dump_json(manifest))

    def save_result(self, result: Mapping[str, Any]) -> None:
        """Write `result.json`, with the room that was kept free for it, and the checksums of the run's files."""
        with contextlib.suppress(OSError):
            (self.path / RESERVE_FILE).unlink()
        self.replace("result.json", _dump_json(result))
        # A folder without checksums can be read too.
        with contextlib.suppress(OSError):
            write_checksums(self.path, *(name for name in _CHECKED_FILES if (self.path / name).is_file()))

    def log_command(self, agent: str, command: Command) -> None:
        """Append a command that took effect to `inputs.log`, one JSON object a line; bytes are base64 text."""
        line = {"agent": agent, **command.model_dump(exclude_none=True)}
        self.append(INPUTS_FILE, (json.dumps(line, default=codec.encode_base64) + "\n").encode())

    def replace(self, name: str, content: str | bytes) -> None:
        """Write a file of the run at once, never half."""
        with self._writing(name):
            replace_file(self.path, name, content.encode() if isinstance(content, str) else content)

    def append(self, name: str, data: bytes) -> None:
        """Add to a file of the run."""
        with self._writing(name):
            append_bytes(self.path, name, data)

    # Makes the folders in which a file belongs, but not the run's own.
    @contextlib.contextmanager
    def _writing(self, name: str) -> Generator[None]:
        try:
            folder = self.path
            for part in name.split("/")[:-1]:
                folder /= part
                folder.mkdir(exist_ok=True)
            yield
        except OSError as error:
            if self.path.is_dir():
                text = format_machine_error(error, name, "a file that can be written", path=self.path / name)
            else:
                text = (
                    f"{name}: expected the run's folder, was gone. Something has taken it away while the run flew, an "
                    f"agent or another program; fly again without it.\nFile: {self.path}"
                )
            raise RunFolderError(text) from error

    def _reserve(self) -> None:
        if not hasattr(os, "posix_fallocate"):
            return
        # If there is no space for it now, writing the first file reports that.
        with contextlib.suppress(OSError):
            fd = open_for_writing(self.path, RESERVE_FILE)
            try:
                os.posix_fallocate(fd, 0, RESERVE_BYTES)
            finally:
                os.close(fd)


def _why_no_scenario(error: OSError | ValueError | yaml.YAMLError) -> str:
    if isinstance(error, OSError):
        return describe_os_error(error)
    if isinstance(error, ValidationError):
        return f"another ({describe_validation_errors(error)[0]})"
    return "no YAML" if isinstance(error, yaml.YAMLError) else "no UTF-8 text"


def _dump_json(content: Mapping[str, Any]) -> str:
    return json.dumps(content, indent=2) + "\n"


def get_package_version(package: str) -> str:
    """Return the version of an installed package, or `missing`."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "missing"


def _read_git_revision() -> str | None:
    folder = Path(__file__).resolve().parents[2]
    if not (folder / ".git").exists():
        return None
    call = ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        return subprocess.run(call, capture_output=True, text=True, timeout=5, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None


def read_cpu_flags() -> str:
    """Return the features of the processor, as reported by the kernel."""
    info = Path("/proc/cpuinfo")
    if not info.exists():
        return platform.processor()
    flags = next((line for line in info.read_text().splitlines() if line.startswith("flags")), "")
    return flags.partition(":")[2].strip()
