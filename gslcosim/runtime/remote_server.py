"""Server of a run for other hosts: scenario, software versions, environment in chunks, and its client."""

import contextlib
import posixpath
import queue
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints

import gslcosim
from gslcosim.base.checksums import write_checksums
from gslcosim.base.code_identity import COMPUTING_PACKAGES, hash_result_code
from gslcosim.base.disk_cache import mark_used
from gslcosim.base.errors import ContractError, EnvironmentDataError, MachineError, RunTimeoutError, SimulationFault
from gslcosim.base.files import remove_tree
from gslcosim.base.kernel_cache import get_cache_root
from gslcosim.bus.interface import Bus
from gslcosim.contract.version import CONTRACT_HASH
from gslcosim.environment.store import (
    ENVIRONMENT_FILES,
    HEADER_FILE,
    REQUIRED_FILES,
    EnvironmentFile,
    load_environment,
)
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.run_dir import get_package_version
from gslcosim.runtime.setup import RunSetup

# These texts come from another host and are printed here.
_Word = Annotated[str, StringConstraints(pattern=r"^[ -~]{0,200}$")]
_COMPARED_PACKAGES = (*COMPUTING_PACKAGES, "eclipse-zenoh")
OFFER_KEY = "rpc/run/offer"
CHUNK_KEY = "rpc/run/piece"
CHUNK_BYTES = 1 << 18
# Upper bounds for the files of a room, and for its header, which is text [bytes].
MAX_ROOM_BYTES, MAX_HEADER_BYTES = 1 << 37, 1 << 26
MAX_SCENARIO_CHARACTERS = 1 << 24
_MAX_ENVIRONMENTS = 10_000
# Becomes part of a path on this host: it cannot lead out of its folder, and is no hidden file.
RunId = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,199}$")]
ContentHash = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{16,128}$")]
RoomNumber = Annotated[int, Field(ge=0, le=_MAX_ENVIRONMENTS)]
Offset = Annotated[int, Field(ge=0, le=MAX_ROOM_BYTES)]
ANSWER_TIMEOUT_S = 15.0
# An answer that has not come by then is requested again, as often as `ANSWER_TIMEOUT_S` allows.
RETRY_AFTER_S = 5.0
# Chunks in transit at once: enough for a link with 200 ms latency, and few for a slow one.
MAX_PENDING_CHUNKS = 16
MAX_OFFER_BYTES = 5 * MAX_SCENARIO_CHARACTERS
# Answers without a request are not kept.
_MAX_QUEUED_ANSWERS = 64
ProgressHandler = Callable[[str], None]


class SoftwareVersions(BaseModel):
    """Versions that have to be equal on all hosts of a run, so that it has the digest that it has on one.

    `code` is a hash of gslcosim's own code without comments and layout, `contract` that of the messages.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    version: _Word
    contract: _Word
    code: _Word
    python: _Word
    packages: Annotated[dict[_Word, _Word], Field(max_length=200)]

    @classmethod
    @cache
    def here(cls) -> "SoftwareVersions":
        """Return the software that this process computes with; the first call after a change of code takes seconds."""
        return cls(
            version=gslcosim.__version__,
            contract=CONTRACT_HASH,
            code=hash_result_code(),
            python=f"{sys.version_info[0]}.{sys.version_info[1]}",
            packages={name: get_package_version(name) for name in _COMPARED_PACKAGES},
        )

    def find_mismatch(self, here: "SoftwareVersions") -> str:
        """Return in one sentence a difference of another host that matters; empty if there is none.

        Args:
            here: Software of the other host; `self` is that of the run.
        """
        if here.version != self.version:
            return f"expected gslcosim {self.version}, which the run has, was {here.version}."
        if here.contract != self.contract:
            return f"expected contract {self.contract}, which the run speaks, was {here.contract}."
        if here.python != self.python:
            return f"expected Python {self.python}, with which the run is flown, was {here.python}."
        others = [
            f"{name} {wanted} (here {here.packages.get(name, 'missing')})"
            for name, wanted in self.packages.items()
            if here.packages.get(name) != wanted
        ]
        if others:
            return f"expected the packages of the run, {', '.join(others)}."
        if here.code != self.code:
            return (
                f"expected gslcosim's code as the run has it, {self.code[:12]}, was {here.code[:12]}: it was changed."
            )
        return ""


def _check_folder(text: str) -> str:
    if "\0" in text or not text.startswith("/") or posixpath.normpath(text) != text:
        raise ValueError("an absolute path without . and ..")
    return text


def _check_sizes(files: dict[str, int]) -> dict[str, int]:
    if not files.keys() >= REQUIRED_FILES or files[HEADER_FILE] > MAX_HEADER_BYTES:
        raise ValueError(f"the files of a room, and at most {MAX_HEADER_BYTES} bytes of {HEADER_FILE}")
    return files


FolderPath = Annotated[str, StringConstraints(max_length=4096), AfterValidator(_check_folder)]


class OfferedEnvironment(protocol.ControlMessage):
    """A room that a run needs: where it is on the run's host, its content, and its files with their sizes [bytes].

    `room` is its number among the rooms of the run: 0 is that of the start.
    """

    room: RoomNumber = 0
    environment_dir: FolderPath
    environment_hash: ContentHash
    room_files: Annotated[dict[EnvironmentFile, Offset], AfterValidator(_check_sizes)]


class RunOffer(OfferedEnvironment):
    """Description of a run for another host before it joins.

    It offers the room of the start, and those that events make of it in `later_rooms`, in the order of their
    situations. `scenario` is the YAML text as resolved; `expected` are the services that are started elsewhere,
    `present` those of them that have come. `paced_from_tick` is as in `Setup`.
    """

    run_id: RunId
    scenario: Annotated[str, StringConstraints(max_length=MAX_SCENARIO_CHARACTERS)]
    later_rooms: Annotated[tuple[OfferedEnvironment, ...], Field(max_length=_MAX_ENVIRONMENTS)] = ()
    expected: Annotated[list[protocol.ParticipantName], Field(max_length=1000)]
    present: Annotated[list[protocol.ParticipantName], Field(max_length=1000)]
    software: SoftwareVersions
    paced_from_tick: protocol.Tick | None = None


class ChunkRequest(protocol.ControlMessage):
    """Ask for a piece of a file of a room."""

    room: RoomNumber = 0
    file: EnvironmentFile
    offset: Offset


class RunServer:
    """Server that answers other hosts, on threads of the bus."""

    def __init__(self, setup: RunSetup, expected: Sequence[str]) -> None:
        self._setup = setup
        self._expected = expected
        self._present: frozenset[str] = frozenset()
        self._changed = threading.Condition()
        self._software = SoftwareVersions.here()
        later = [(setup.environment.later_rooms[each].content_hash, at) for each, at in setup.later_rooms.items()]
        self._rooms = [
            OfferedEnvironment(
                room=i,
                environment_dir=str(folder),
                environment_hash=content,
                room_files={
                    name: (folder / name).stat().st_size for name in ENVIRONMENT_FILES if (folder / name).is_file()
                },
            )
            for i, (content, folder) in enumerate([(setup.environment.content_hash, setup.environment_dir), *later])
        ]

    def serve_on(self, bus: Bus) -> None:
        """Answer from now on."""
        bus.watch_alive(protocol.build_liveliness_key("*"), self._on_alive)
        bus.answer(OFFER_KEY, lambda _: [self._offer()])
        bus.answer(CHUNK_KEY, self._piece)

    def wait_until_gone(self, limit_s: float) -> None:
        """Wait until all services on other hosts have left, or until a limit [s]."""
        with self._changed:
            self._changed.wait_for(lambda: self._present.isdisjoint(self._expected), limit_s)

    def _on_alive(self, key: str, is_alive: bool) -> None:  # noqa: FBT001 - the interface of the bus
        name = {key.split("/")[1]}
        with self._changed:
            self._present = self._present | name if is_alive else self._present - name
            self._changed.notify_all()

    def _offer(self) -> bytes:
        present = self._present
        first, *later = self._rooms
        return RunOffer(
            **first.model_dump(),
            later_rooms=tuple(later),
            run_id=self._setup.run_dir.run_id,
            scenario=self._setup.run_dir.scenario.read_text(),
            expected=list(self._expected),
            present=[name for name in self._expected if name in present],
            software=self._software,
            paced_from_tick=self._setup.paced_from_tick,
        ).to_bytes()

    def _piece(self, question: bytes) -> list[bytes]:
        try:
            request = ChunkRequest.from_bytes(question)
        except ContractError:
            return []
        if request.room >= len(self._rooms):
            return []
        room = self._rooms[request.room]
        if request.file not in room.room_files:
            return []
        with (Path(room.environment_dir) / request.file).open("rb") as file:
            file.seek(request.offset)
            return [file.read(CHUNK_BYTES)]


def fetch_offer(bus: Bus) -> RunOffer:
    """Return the offer of the run's own host."""
    answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    deadline_s = time.monotonic() + ANSWER_TIMEOUT_S
    while time.monotonic() < deadline_s:
        bus.ask(OFFER_KEY, b"", lambda _, payload: answers.put(payload))
        try:
            payload = answers.get(timeout=RETRY_AFTER_S)
        except queue.Empty:
            continue
        if len(payload) > MAX_OFFER_BYTES:
            raise SimulationFault(
                f"the run's offer: expected at most {MAX_OFFER_BYTES} bytes, was {len(payload)}. Join runs of hosts "
                "that you trust."
            )
        try:
            return RunOffer.from_bytes(payload)
        except ContractError as error:
            raise SimulationFault(
                f"the run's offer: {error} Install the same gslcosim on both hosts, and join runs of hosts that you "
                "trust."
            ) from error
    raise RunTimeoutError(
        f"expected the run's supervisor to tell of it within {ANSWER_TIMEOUT_S:g} s, it did not. It must have been "
        "started with --elsewhere."
    )


def find_local_environment(offer: OfferedEnvironment) -> Path | None:
    """Return a folder of this host with a room of a run; None where there is none."""
    here = get_cache_root() / "environments"
    named = Path(offer.environment_dir)
    for folder in (named, here / named.name, here / offer.environment_hash):
        mark_used(folder)
        # Opening a pipe would block forever; the run's host determines the folder.
        if any((folder / name).exists() and not (folder / name).is_file() for name in ENVIRONMENT_FILES):
            continue
        try:
            if load_environment(folder).content_hash == offer.environment_hash:
                return folder
        except EnvironmentDataError:
            continue
    return None


def fetch_environment(bus: Bus, offer: OfferedEnvironment, say: ProgressHandler) -> Path:
    """Return a folder in the cache of this host with a room of a run, fetched piece by piece."""
    folder = get_cache_root() / "environments" / offer.environment_hash
    mark_used(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    total = sum(offer.room_files.values())
    if (free := shutil.disk_usage(folder.parent).free) < total:
        raise MachineError(
            f"the room of the run: expected {total / 1e6:.1f} MB on the disk of the cache, was {free / 1e6:.1f} MB. "
            f"Free the disk, or set GSLCOSIM_CACHE.\nFolder: {folder.parent}"
        )
    said_at_s, n_bytes = time.monotonic(), 0
    say(f"fetching the room, {total / 1e6:.1f} MB")
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".fetched.", ignore_cleanup_errors=True) as beside:
        filling = Path(beside) / "room"
        filling.mkdir()
        for name, size in offer.room_files.items():
            with (filling / name).open("wb") as file:
                for offset, piece in _fetch_chunks(bus, offer.room, name, size):
                    file.seek(offset)
                    file.write(piece)
                    n_bytes += len(piece)
                    if time.monotonic() - said_at_s > 2.0:
                        said_at_s = time.monotonic()
                        say(f"fetching the room, {n_bytes / 1e6:.1f} of {total / 1e6:.1f} MB")
        try:
            found = load_environment(filling).content_hash
        except EnvironmentDataError as error:
            raise SimulationFault(f"the fetched room: {error}") from error
        if found != offer.environment_hash:
            raise SimulationFault(f"the fetched room: expected content {offer.environment_hash}, was {found}.")
        write_checksums(filling, *offer.room_files, place=folder.name)
        remove_tree(folder, ignore_errors=True)
        try:
            filling.rename(folder)
        except OSError:
            if not folder.is_dir():  # otherwise another process was faster
                raise
    return folder


# Chunks come in any order, several in transit at once; a missing one is requested again.
def _fetch_chunks(bus: Bus, room: int, file: EnvironmentFile, size: int) -> Iterator[tuple[int, bytes]]:
    came: queue.SimpleQueue[tuple[int, bytes]] = queue.SimpleQueue()

    def ask(offset: int) -> None:
        bus.ask(
            CHUNK_KEY,
            ChunkRequest(room=room, file=file, offset=offset).to_bytes(),
            lambda _, payload: came.put((offset, payload)) if is_wanted(payload) else None,
        )

    def is_wanted(payload: bytes) -> bool:
        return len(payload) <= CHUNK_BYTES and came.qsize() < _MAX_QUEUED_ANSWERS

    to_ask = iter(range(0, size, CHUNK_BYTES))
    n_left = -(-size // CHUNK_BYTES)
    awaited: set[int] = set()
    patient_until_s = time.monotonic() + ANSWER_TIMEOUT_S
    while n_left:
        for offset in islice(to_ask, MAX_PENDING_CHUNKS - len(awaited)):
            awaited.add(offset)
            ask(offset)
        with contextlib.suppress(queue.Empty):
            offset, piece = came.get(timeout=RETRY_AFTER_S)
            if offset in awaited and len(piece) == min(CHUNK_BYTES, size - offset):
                awaited.discard(offset)
                n_left -= 1
                patient_until_s = time.monotonic() + ANSWER_TIMEOUT_S
                yield offset, piece
                continue
        # No answer has come, or one that is no chunk of this file.
        if time.monotonic() > patient_until_s:
            raise RunTimeoutError(f"{file} of the room: expected a piece within {ANSWER_TIMEOUT_S:g} s, none came.")
        if came.empty():
            for offset in awaited:
                ask(offset)
