"""What the host that flies a run offers to others: its scenario, what it computes with, and its room, in pieces."""

import posixpath
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, StringConstraints

from gslcosim.bus.port import Bus
from gslcosim.environment.store import HEADER_FILE, MESHES_FILE, OCCUPANCY_FILE, WIND_FILE
from gslcosim.errors import ContractError
from gslcosim.runtime.hosts.software import Software
from gslcosim.runtime.over_bus import control
from gslcosim.runtime.setup import Setup

OFFER_KEY = "rpc/run/offer"
PIECE_KEY = "rpc/run/piece"
PIECE_BYTES = 1 << 18
# As `RoomFile` has them.
ROOM_FILES: tuple["RoomFile", ...] = (HEADER_FILE, OCCUPANCY_FILE, WIND_FILE, MESHES_FILE)


# Larger files of rooms than these [bytes] do not exist; the header is text.
MAX_ROOM_BYTES, MAX_HEADER_BYTES = 1 << 37, 1 << 26
MAX_SCENARIO_CHARACTERS = 1 << 24
_MAX_ROOMS = 10_000


def _check_folder(text: str) -> str:
    if "\0" in text or not text.startswith("/") or posixpath.normpath(text) != text:
        raise ValueError("an absolute path without . and ..")
    return text


def _check_sizes(files: dict[str, int]) -> dict[str, int]:
    if not {HEADER_FILE, OCCUPANCY_FILE, WIND_FILE} <= files.keys() or files[HEADER_FILE] > MAX_HEADER_BYTES:
        raise ValueError(f"the files of a room, and at most {MAX_HEADER_BYTES} bytes of {HEADER_FILE}")
    return files


# A part of a path of this host: it cannot lead out of the folder that it is put into, and is no hidden file.
RunId = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,199}$")]
ContentHash = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{16,128}$")]
FolderPath = Annotated[str, StringConstraints(max_length=4096), AfterValidator(_check_folder)]
RoomFile = Literal["environment.yaml", "occupancy.npy", "wind.npy", "visual.glb"]
RoomNumber = Annotated[int, Field(ge=0, le=_MAX_ROOMS)]
Offset = Annotated[int, Field(ge=0, le=MAX_ROOM_BYTES)]


class OfferedRoom(control.Control):
    """A room that a run needs: where it is on the run's host, its content, and its files with their sizes [bytes].

    `room` is its number among the rooms of the run: 0 is that of the start.
    """

    room: RoomNumber = 0
    environment_dir: FolderPath
    environment_hash: ContentHash
    room_files: Annotated[dict[RoomFile, Offset], AfterValidator(_check_sizes)]


class RunOffer(OfferedRoom):
    """What another host is told of a run before it takes part.

    It offers the room of the start, and those that events make of it in `later_rooms`, in the order of their
    situations. `scenario` is the YAML text as resolved; `expected` are the services that are started elsewhere,
    `present` those of them that have come. `paced_from_tick` is as in `Setup`.
    """

    run_id: RunId
    scenario: Annotated[str, StringConstraints(max_length=MAX_SCENARIO_CHARACTERS)]
    later_rooms: Annotated[tuple[OfferedRoom, ...], Field(max_length=_MAX_ROOMS)] = ()
    expected: Annotated[list[control.ParticipantName], Field(max_length=1000)]
    present: Annotated[list[control.ParticipantName], Field(max_length=1000)]
    software: Software
    paced_from_tick: control.Tick | None = None


class PieceRequest(control.Control):
    """Ask for a piece of a file of a room."""

    room: RoomNumber = 0
    file: RoomFile
    offset: Offset


class Offering:
    """Answers other hosts, on threads of the bus.

    Args:
        setup: The run.
        expected: The services that are started elsewhere.
    """

    def __init__(self, setup: Setup, expected: Sequence[str]) -> None:
        self._setup = setup
        self._expected = expected
        self._present: frozenset[str] = frozenset()
        self._changed = threading.Condition()
        self._software = Software.here()
        later = [(setup.environment.later_rooms[each].content_hash, at) for each, at in setup.later_rooms.items()]
        self._rooms = [
            OfferedRoom(room=i, environment_dir=str(folder), environment_hash=content, room_files=_files_in(folder))
            for i, (content, folder) in enumerate([(setup.environment.content_hash, setup.environment_dir), *later])
        ]

    def answer_on(self, bus: Bus) -> None:
        """Answer from now on."""
        bus.watch_alive(control.alive("*"), self._on_alive)
        bus.answer(OFFER_KEY, lambda _: [self._offer()])
        bus.answer(PIECE_KEY, self._piece)

    def wait_until_gone(self, limit_s: float) -> None:
        """Return when all services that are elsewhere have left, or after a limit [s]."""
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
            request: PieceRequest = PieceRequest.from_bytes(question)
        except ContractError:
            return []
        if request.room >= len(self._rooms):
            return []
        room = self._rooms[request.room]
        if request.file not in room.room_files:
            return []
        with (Path(room.environment_dir) / request.file).open("rb") as file:
            file.seek(request.offset)
            return [file.read(PIECE_BYTES)]


def _files_in(folder: Path) -> "dict[RoomFile, int]":
    return {name: (folder / name).stat().st_size for name in ROOM_FILES if (folder / name).is_file()}
