"""Machine-dependent notes of a run (times, faults), in a file beside the recording and merged into it at the end."""

import contextlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypedDict

import msgspec

from gslcosim.base.files import open_for_writing, read_regular_file, write_all
from gslcosim.base.untrusted_json import MalformedFileError, parse_json

NAME = "machine.log"


_MAX_BYTES = 1_000_000_000


class _Note(TypedDict, total=False):
    tick: Annotated[int, msgspec.Meta(ge=-1, lt=1 << 62)]
    agent: str
    decided_ms: float
    participant: str
    fault: str
    sandboxes: dict[str, str]


class MachineLog:
    """Writes notes as they come, a line of JSON each; where that fails a run goes on without them.

    Args:
        folder: The run's; absent: nothing is written.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._fd: int | None = None

    def decided(self, agent: str, tick: int, taken_s: float) -> None:
        """Note how long an agent has taken for its answer to the observation of a tick, by the clock [s]."""
        self._write({"agent": agent, "tick": tick, "decided_ms": round(taken_s * 1e3, 4)})

    def failed(self, participant: str, tick: int, text: str) -> None:
        """Note a fault."""
        self._write({"participant": participant, "tick": tick, "fault": text})

    def confined(self, sandboxes: Mapping[str, str]) -> None:
        """Note by agent and participant what its process is confined by."""
        self._write({"sandboxes": dict(sandboxes)})

    def close(self) -> None:
        """Release the file."""
        if self._fd is not None:
            os.close(self._fd)
        self._fd = self._folder = None

    def _write(self, note: Mapping[str, Any]) -> None:
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


@dataclass(frozen=True, kw_only=True)
class MachineNotes:
    """Notes read back: by agent (tick, ms) of each decision, (tick, participant, text) of each fault, and sandboxes."""

    decisions_ms: Mapping[str, Sequence[tuple[int, float]]] = field(default_factory=dict[str, list[tuple[int, float]]])
    faults: Sequence[tuple[int, str, str]] = ()
    sandboxes: Mapping[str, str] = field(default_factory=dict[str, str])


def read_machine_notes(folder: Path) -> MachineNotes:
    """Return what was noted in the folder of a run: nothing where nothing was, or where the file is elsewhere."""
    try:
        lines = read_regular_file(folder / NAME, max_bytes=_MAX_BYTES).splitlines()
    except OSError:
        return MachineNotes()
    decisions: dict[str, list[tuple[int, float]]] = {}
    faults: list[tuple[int, str, str]] = []
    sandboxes: dict[str, str] = {}
    for line in lines:
        # Of a file that was cut off, or that an agent has written into, only what is one of our lines counts.
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
