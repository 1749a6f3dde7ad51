"""Snapshots of a run: each participant's state, inputs and digests at a tick, and agents' observations until then.

A file is a chain of pieces: four bytes of length, big-endian, and compressed observations, each behind four bytes of
length of its own.
"""

import functools
import hashlib
import inspect
import io
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgpack  # pyright: ignore[reportMissingTypeStubs]

import gslcosim
from gslcosim.base.code_identity import COMPUTING_PACKAGES, hash_code, list_package_files, list_registered_files
from gslcosim.base.errors import SnapshotError
from gslcosim.base.extension_packages import find_extension_packages
from gslcosim.base.files import open_regular_file, read_regular_file
from gslcosim.base.kernel_cache import is_signed, sign
from gslcosim.contract import codec
from gslcosim.contract.length_prefix import prefix_length, read_frame
from gslcosim.contract.messages import Message
from gslcosim.contract.participant import Core, SupportsSnapshots
from gslcosim.contract.version import CONTRACT_HASH
from gslcosim.environment.model import Environment
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.replay.object_state import ObjectState
from gslcosim.runtime.run_dir import RunDir, get_package_version
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.base import Spec
from gslcosim.vehicles import Vehicle

# A room, a scenario and vehicles never change in a run, and are there when it goes on.
_IMMUTABLE_TYPES = (Environment, Spec, Vehicle)
SCHEMA = "gslcosim/snapshot/2"
SNAPSHOTS_FOLDER = "snapshots"
_SNAPSHOT_SUFFIX = ".snap"
# Code that holds states, and code that computes from them.
_STATE_CODE = (
    *(f"gslcosim_services/{name}" for name in ("cameras", "events", "fields", "radio", "referee", "sensing", "world")),
    *(f"gslcosim/{name}" for name in (
        "contract", "environment", "scenario", "vehicles", "runtime/replay", "runtime/stepper.py", "base/rng.py",
        "base/ticks.py",
    )),
)  # fmt: skip
_msgpack: Any = msgpack
OBSERVATIONS_FOLDER = "told"
_CHUNK_TICKS = 64
_CHUNK_BYTES = 1 << 20
# One observation may be larger than a chunk.
_MAX_UNPACKED_BYTES = 1 << 30


def build_state_adapter(core: Core) -> SupportsSnapshots:
    """Return the adapter that reads and restores the state of a core that has just been built."""
    if isinstance(core, SupportsSnapshots):
        return core
    # Models of an extension stand within cores of services.
    packages = frozenset({"gslcosim", *find_extension_packages()})
    return ObjectState(core, fixed=_IMMUTABLE_TYPES, packages=packages)


@dataclass(frozen=True, kw_only=True)
class CodeIdentity:
    """Identity of the code that wrote a state: the contract, a hash of the code, versions of packages."""

    contract: str
    code: str
    packages: str
    version: str

    @classmethod
    @functools.cache
    def read_own(cls) -> "CodeIdentity":
        """Return that of this process."""
        return cls(
            contract=CONTRACT_HASH,
            code=hash_code([*list_package_files(*_STATE_CODE), *list_registered_files()]),
            packages=", ".join(f"{name} {get_package_version(name)}" for name in COMPUTING_PACKAGES),
            version=gslcosim.__version__,
        )

    def find_difference(self, other: "CodeIdentity") -> str:
        """Return in which respect another cannot use the state, empty where it can."""
        if self.contract != other.contract:
            return f"another contract ({self.contract}, flown by gslcosim {self.version})"
        if self.packages != other.packages:
            return f"other packages ({self.packages})"
        return f"other code (gslcosim {self.version})" if self.code != other.code else ""


@dataclass(frozen=True, kw_only=True)
class SnapshotPart:
    """State with which one participant resumes before the step of `tick`.

    `state` is that of its core, `memory` that of its gate, `trails` are its chains of hashes by port, and `outputs` the
    messages, as (port, payload), that a reader may still need. `made_by` hashes the code of a core of another package.
    """

    participant: str
    tick: int
    state: Mapping[str, Any]
    memory: Mapping[str, Any]
    trails: Mapping[str, Any]
    outputs: list[tuple[str, bytes]]
    made_by: str = ""

    @property
    def name(self) -> str:
        """The name of its file below the folder of snapshots."""
        return f"{self.tick:09d}/{self.participant}{_SNAPSHOT_SUFFIX}"

    def to_bytes(self) -> bytes:
        """Return what a file of it holds."""
        body = zlib.compress(_msgpack.packb(vars(self)), 1)
        head = {"schema": SCHEMA, "identity": asdict(CodeIdentity.read_own())}
        return _msgpack.packb([head | {"signature": sign(self.name, _msgpack.packb([head, body]))}, body])

    @classmethod
    def from_bytes(cls, data: bytes, path: Path, *, is_of_this_run: bool = False) -> "SnapshotPart":
        """Return what a file holds.

        Args:
            is_of_this_run: True where the run that has written it goes on: then it needs no signature.
        """
        try:
            head, body = _msgpack.unpackb(data)
            identity = CodeIdentity(**head["identity"]) if head["schema"] == SCHEMA else None
            signed, signature = {key: head[key] for key in ("schema", "identity")}, bytes(head.get("signature") or b"")
        except (ValueError, KeyError, TypeError, AttributeError, msgpack.UnpackException) as error:
            raise SnapshotError(f"damaged ({error})") from error
        if identity is None:
            raise SnapshotError("of another format")
        if difference := identity.find_difference(CodeIdentity.read_own()):
            raise SnapshotError(f"of {difference}")
        # Compiled code trusts the numbers in a state: one from elsewhere is as good as a program.
        place = f"{path.parent.name}/{path.name}"
        if not is_of_this_run and not is_signed(place, _msgpack.packb([signed, body]), signature, path):
            raise SnapshotError("not signed with the key of this cache: taken elsewhere, or changed since")
        fields: dict[str, Any] = _msgpack.unpackb(zlib.decompress(body), strict_map_key=False)
        fields["outputs"] = [(str(port), bytes(payload)) for port, payload in fields["outputs"]]
        return cls(**fields)


def hash_external_core(core: object) -> str:
    """Return a hash of the file of a core of another package; empty for our own, which have a version."""
    if type(core).__module__.startswith("gslcosim."):
        return ""
    try:
        code = Path(inspect.getfile(type(core))).read_bytes()
        return hashlib.blake2b(code, digest_size=16).hexdigest()
    except (OSError, TypeError):
        return ""


class ObservationLog:
    """Log of one agent's observations in order, with which another agent can be brought up to date."""

    def __init__(self, run_dir: RunDir, agent: str) -> None:
        self._run_dir = run_dir
        self._name = f"snapshots/{OBSERVATIONS_FOLDER}/{agent}.log"
        self._waiting: list[bytes] = []
        self._n_bytes = 0

    def add(self, payload: bytes) -> None:
        """Keep an observation."""
        self._waiting.append(payload)
        self._n_bytes += len(payload)
        if len(self._waiting) >= _CHUNK_TICKS or self._n_bytes >= _CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write what waits."""
        if not self._waiting:
            return
        piece = zlib.compress(b"".join(prefix_length(payload) for payload in self._waiting), 1)
        self._waiting.clear()
        self._n_bytes = 0
        self._run_dir.append(self._name, prefix_length(piece))


def read_observations(folder: Path, agent: str) -> Iterator[bytes]:
    """Yield the observations of an agent, from tick 0 on."""
    try:
        with open_regular_file(folder / f"{agent}.log") as file:
            while (piece := read_frame(file)) is not None:
                unpacker = zlib.decompressobj()
                observations = io.BytesIO(unpacker.decompress(piece, _MAX_UNPACKED_BYTES))
                if not unpacker.eof or unpacker.unused_data:
                    raise SnapshotError(f"without what {agent} was told (damaged)")
                while (observation := read_frame(observations)) is not None:
                    yield observation
    except (OSError, zlib.error) as error:
        raise SnapshotError(f"without what {agent} was told ({error})") from error
    raise SnapshotError(f"without all that {agent} was told")


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """State of a run before the step of `tick`, in `folder`, with all observations of `agents` until then."""

    folder: Path
    tick: int
    agents: tuple[str, ...]

    @classmethod
    def at(cls, folder: Path, scenario: Scenario) -> "Snapshot":
        """Return the snapshot in a folder, whose name is its tick."""
        return cls(folder=folder, tick=int(folder.name), agents=tuple(agent.name for agent in scenario.agents))

    def part(self, participant: str) -> SnapshotPart:
        """Return what a participant needs."""
        return _load_part(self.folder, participant)

    def messages(self, dataflow: Dataflow) -> list[tuple[str, Message]]:
        """Return the messages that a reader may still need, with their ports."""
        return [
            (port, codec.decode(dataflow.message_types[port], payload))
            for spec in dataflow.participants
            if (self.folder / f"{spec.name}{_SNAPSHOT_SUFFIX}").is_file()
            for port, payload in self.part(spec.name).outputs
        ]

    def read_observations(self) -> Iterator[list[tuple[str, bytes]]]:
        """Yield for each tick before the snapshot the observations, by agent."""
        streams = [read_observations(self.folder.parent / OBSERVATIONS_FOLDER, agent) for agent in self.agents]
        for _ in range(self.tick):
            yield [(agent, next(stream)) for agent, stream in zip(self.agents, streams, strict=True)]


def save_part(run_dir: RunDir, part: SnapshotPart) -> None:
    """Write a part of a snapshot at once."""
    run_dir.replace(f"{SNAPSHOTS_FOLDER}/{part.name}", part.to_bytes())


def find_latest_parts(run_dir: RunDir, participants: Sequence[str]) -> list[SnapshotPart]:
    """Return the parts of one process at the last tick of which all its participants have one; empty: there is none."""
    for folder in reversed(_list_folders(run_dir)):
        try:
            return [_load_part(folder, participant, is_of_this_run=True) for participant in participants]
        except SnapshotError:
            continue
    return []


def find_nearest_snapshot(
    run_dir: RunDir, scenario: Scenario, participants: Sequence[str], *, until_tick: int
) -> tuple[Snapshot | None, str]:
    """Return the last snapshot at or before a tick that can be used, or why there is none, as a sentence.

    Args:
        scenario: The run's, with whose agents' observations the snapshot is complete.
    """
    folders = [folder for folder in _list_folders(run_dir) if int(folder.name) <= until_tick]
    reason = ""
    for folder in reversed(folders):
        snapshot = Snapshot.at(folder, scenario)
        try:
            for participant in participants:
                snapshot.part(participant)
            for _ in snapshot.read_observations():
                pass
        except SnapshotError as error:
            reason = (
                reason or f"The snapshot of {run_dir.run_id} at tick {snapshot.tick} cannot be used: it is {error}."
            )
        else:
            return snapshot, ""
    return None, reason


def _list_folders(run_dir: RunDir) -> list[Path]:
    shelf = run_dir.path / SNAPSHOTS_FOLDER
    return sorted(folder for folder in shelf.glob("*") if folder.name.isdecimal()) if shelf.is_dir() else []


def _load_part(folder: Path, participant: str, *, is_of_this_run: bool = False) -> SnapshotPart:
    path = folder / f"{participant}{_SNAPSHOT_SUFFIX}"
    try:
        data = read_regular_file(path)
    except OSError as error:
        raise SnapshotError(f"without the part of {participant} ({error.strerror})") from error
    part = SnapshotPart.from_bytes(data, path, is_of_this_run=is_of_this_run)
    if part.participant != participant or part.tick != int(folder.name):
        raise SnapshotError("damaged")
    return part
