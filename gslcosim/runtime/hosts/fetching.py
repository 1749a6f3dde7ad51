"""Getting what a host needs of a run that is flown on another: its offer, and its room where it is not here."""

import contextlib
import queue
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from gslcosim._kernel_cache import cache_root
from gslcosim.bus.port import Bus
from gslcosim.disk_cache import mark_used
from gslcosim.environment.store import load_environment
from gslcosim.errors import ContractError, EnvironmentDataError, MachineError, RunTimeoutError, SimulationFault
from gslcosim.runtime.hosts.offering import (
    MAX_SCENARIO_CHARACTERS,
    OFFER_KEY,
    PIECE_BYTES,
    PIECE_KEY,
    ROOM_FILES,
    OfferedRoom,
    PieceRequest,
    RoomFile,
    RunOffer,
)

ANSWER_WITHIN_S = 15.0
# What has not come by then is asked for again, as often as `ANSWER_WITHIN_S` allows.
ASK_AGAIN_AFTER_S = 5.0
# Pieces that are on their way at once: enough for a link of 200 ms, and little for one that is slow.
PIECES_AT_ONCE = 16
MAX_OFFER_BYTES = 5 * MAX_SCENARIO_CHARACTERS
# Answers that nobody has asked for are not kept.
_MAX_WAITING = 64

Say = Callable[[str], None]


def fetch_offer(bus: Bus) -> RunOffer:
    """Return what the run's own host tells of it.

    Raises:
        RunTimeoutError: it does not answer.
        SimulationFault: it tells what no run is.
    """
    answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    deadline_s = time.monotonic() + ANSWER_WITHIN_S
    while time.monotonic() < deadline_s:
        bus.ask(OFFER_KEY, b"", lambda _, payload: answers.put(payload))
        try:
            payload = answers.get(timeout=ASK_AGAIN_AFTER_S)
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
        f"expected the run's supervisor to tell of it within {ANSWER_WITHIN_S:g} s, it did not. It must have been "
        "started with --elsewhere."
    )


def room_here(offer: OfferedRoom) -> Path | None:
    """Return a folder of this host with a room of a run; None where there is none."""
    here = cache_root() / "environments"
    named = Path(offer.environment_dir)
    for folder in (named, here / named.name, here / offer.environment_hash):
        mark_used(folder)
        if any(_is_special(folder / name) for name in ROOM_FILES):
            continue
        try:
            if load_environment(folder).content_hash == offer.environment_hash:
                return folder
        except EnvironmentDataError:
            continue
    return None


# To open a pipe would wait for ever; the run's host names the folder.
def _is_special(path: Path) -> bool:
    return path.exists() and not path.is_file()


def fetch_room(bus: Bus, offer: OfferedRoom, say: Say) -> Path:
    """Return a folder in the cache of this host with a room of a run, fetched piece by piece.

    Args:
        bus: The connection to the run.
        offer: What it offers.
        say: Is told how far it has come.

    Raises:
        RunTimeoutError: a piece does not come.
        MachineError: there is no space on the disk for it.
        SimulationFault: what has come is not the room that was offered.
    """
    folder = cache_root() / "environments" / offer.environment_hash
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
                for offset, piece in _pieces(bus, offer.room, name, size):
                    file.seek(offset)
                    file.write(piece)
                    n_bytes += len(piece)
                    if time.monotonic() - said_at_s > 2.0:
                        said_at_s = time.monotonic()
                        say(f"fetching the room, {n_bytes / 1e6:.1f} of {total / 1e6:.1f} MB")
        try:
            found = load_environment(filling, check_hash=True).content_hash
        except EnvironmentDataError as error:
            raise SimulationFault(f"the fetched room: {error}") from error
        if found != offer.environment_hash:
            raise SimulationFault(f"the fetched room: expected content {offer.environment_hash}, was {found}.")
        shutil.rmtree(folder, ignore_errors=True)
        try:
            filling.rename(folder)
        except OSError:
            if not folder.is_dir():  # otherwise another process was faster
                raise
    return folder


# In any order, several on their way at once; what does not come is asked for again.
def _pieces(bus: Bus, room: int, file: RoomFile, size: int) -> Iterator[tuple[int, bytes]]:
    came: queue.SimpleQueue[tuple[int, bytes]] = queue.SimpleQueue()

    def ask(offset: int) -> None:
        bus.ask(
            PIECE_KEY,
            PieceRequest(room=room, file=file, offset=offset).to_bytes(),
            lambda _, payload: came.put((offset, payload)) if is_wanted(payload) else None,
        )

    def is_wanted(payload: bytes) -> bool:
        return len(payload) <= PIECE_BYTES and came.qsize() < _MAX_WAITING

    to_ask = iter(range(0, size, PIECE_BYTES))
    n_left = -(-size // PIECE_BYTES)
    awaited: set[int] = set()
    patient_until_s = time.monotonic() + ANSWER_WITHIN_S
    while n_left:
        for offset in islice(to_ask, PIECES_AT_ONCE - len(awaited)):
            awaited.add(offset)
            ask(offset)
        with contextlib.suppress(queue.Empty):
            offset, piece = came.get(timeout=ASK_AGAIN_AFTER_S)
            if offset in awaited and len(piece) == min(PIECE_BYTES, size - offset):
                awaited.discard(offset)
                n_left -= 1
                patient_until_s = time.monotonic() + ANSWER_WITHIN_S
                yield offset, piece
                continue
        # Nothing has come, or what is no piece of this file.
        if time.monotonic() > patient_until_s:
            raise RunTimeoutError(f"{file} of the room: expected a piece within {ANSWER_WITHIN_S:g} s, none came.")
        if came.empty():
            for offset in awaited:
                ask(offset)
