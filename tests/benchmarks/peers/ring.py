"""What the five participants of each peer have in common; needs nothing but Python, so it runs beside any package.

Each participant reads the one before it. In the open shape the first one reads nobody, so everybody may run ahead; in
the closed one it reads what the last one, the agent, wrote a tick earlier, so every tick waits for all five in turn.
"""

import json
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

NAMES = ("world", "fields", "sensing", "referee", "agent")
SHAPES = ("closed", "open")
TEXT_BYTES = 200


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a participant stands: whom it reads, if anybody, and from how many ticks ago."""

    index: int
    name: str
    reads: str | None
    delay_ticks: int = 0


def places(shape: str) -> tuple[Place, ...]:
    """Return the five places of a shape, in the order of a tick."""
    first = Place(index=0, name=NAMES[0], reads=NAMES[-1] if shape == "closed" else None, delay_ticks=1)
    others = (Place(index=i, name=name, reads=NAMES[i - 1]) for i, name in enumerate(NAMES) if i)
    return (first, *others)


def text_of(name: str, tick: int) -> str:
    """Return what a participant says at a tick."""
    return f"{name} {tick} ".ljust(TEXT_BYTES, ".")


@dataclass
class Participant:
    """The same for all peers: checks what it read, says the next thing, and remembers when it began and ended."""

    place: Place
    _began_ns: int = field(default=0, init=False)

    def step(self, tick: int, received: str) -> str:
        """Return what it says at a tick; `received` is empty where it reads nobody.

        Raises:
            ValueError: it heard something else than what the one before it said.
        """
        if tick == 0:
            self._began_ns = time.monotonic_ns()
        due = tick - self.place.delay_ticks
        expected = text_of(self.place.reads, due) if self.place.reads and due >= 0 else ""
        if received != expected:
            raise ValueError(f"{self.place.name} at tick {tick}: expected {expected!r}, was {received!r}.")
        return text_of(self.place.name, tick)

    def save_times(self, folder: Path) -> None:
        """Write when the first step began and the last one ended; to be called right after that."""
        times = {"began_ns": self._began_ns, "ended_ns": time.monotonic_ns()}
        (folder / f"{self.place.name}.json").write_text(json.dumps(times))


def ticks_per_s(folder: Path, n_ticks: int) -> float:
    """Return the speed from the first step of anybody to the last step of anybody; starting is left out."""
    times = [json.loads((folder / f"{name}.json").read_text()) for name in NAMES]
    wall_ns = max(times_of_one["ended_ns"] for times_of_one in times) - min(
        times_of_one["began_ns"] for times_of_one in times
    )
    return n_ticks / (wall_ns * 1e-9)


def run_processes(commands: Sequence[Sequence[str]]) -> None:
    """Run one process for each command until all have ended; none is left behind.

    Raises:
        RuntimeError: one of them failed.
    """
    processes = [subprocess.Popen(command) for command in commands]
    try:
        while running := [process for process in processes if process.poll() is None]:
            if any(process.returncode for process in processes):
                break
            try:
                running[0].wait(timeout=0.1)
            except subprocess.TimeoutExpired:
                continue
    finally:
        for process in processes:
            process.kill()
            process.wait()
    if any(process.returncode for process in processes):
        raise RuntimeError(f"expected all participants to end well, was {[p.returncode for p in processes]}.")
