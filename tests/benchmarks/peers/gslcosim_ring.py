"""Five trivial cores in processes of their own, hosted as a run hosts its services; prints ticks per second as JSON.

    python tests/benchmarks/peers/gslcosim_ring.py --shape closed --ticks 2000

Router, accounts, hosts, gates, digests and watchdog are those of a run; world, gas, agents and recorder are left out.
"""

import argparse
import json
import queue
import shutil
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from ring import NAMES, SHAPES, Participant, Place, places, ticks_per_s

from gslcosim.bus.port import Bus, Join
from gslcosim.command_lines import exit_text
from gslcosim.contract.messages import Message
from gslcosim.contract.participant import Episode, Inbox, Outbox, ParticipantSpec, Read, Write
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.joining import JOIN_LIMIT_S, Network
from gslcosim.runtime.over_bus import control
from gslcosim.runtime.over_bus.router import RunRouter
from gslcosim.runtime.over_bus.service import take_part
from gslcosim.runtime.over_bus.watchdog import Watchdog
from gslcosim.runtime.processes import EXIT_LIMIT_S, Children
from gslcosim.runtime.run_dir import RunDir

LOOK_EVERY_S = 0.1
ENDED = "ended"


class Said(Message):
    """What a participant says at a tick."""

    text: str


def spec_of(place: Place) -> ParticipantSpec:
    """Return the dataflow of a participant."""
    reads = (Read(port=f"ring/{place.reads}", delay_ticks=place.delay_ticks),) if place.reads else ()
    return ParticipantSpec(name=place.name, reads=reads, writes=(Write(port=f"ring/{place.name}", message_type=Said),))


def dataflow_of(shape: str) -> Dataflow:
    """Return how the five are wired."""
    return Dataflow(tuple(spec_of(place) for place in places(shape)))


class TrivialCore:
    """One participant as gslcosim sees it."""

    def __init__(self, place: Place, n_ticks: int, folder: Path) -> None:
        self.spec = spec_of(place)
        self._participant, self._n_ticks, self._folder = Participant(place), n_ticks, folder

    def reset(self, episode: Episode) -> Outbox:
        """Remember nothing."""
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Say the next thing."""
        heard = next((message.text for message in inbox.values() if isinstance(message, Said)), "")
        text = self._participant.step(tick, heard)
        if tick == self._n_ticks - 1:
            self._participant.save_times(self._folder)
        return {f"ring/{self.spec.name}": Said(tick=tick, text=text)}


class Watch:
    """What the supervisor of a run does where nothing is simulated: waits for all, starts them, sees them finish."""

    def __init__(self, bus: Bus, run_dir: RunDir) -> None:
        self._bus = bus
        self._watchdog = Watchdog([(name,) for name in NAMES], run_dir)
        self._notes: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        self._alive: set[str] = set()

    def listen(self) -> None:
        """Hear participants from now on."""
        for key in (control.progress("*"), control.waiting("*"), control.bye("*"), control.FAULT):
            self._bus.subscribe(key, lambda at, payload: self._notes.put((at, payload)))
        self._bus.watch_alive(control.alive("*"), lambda at, _: self._notes.put((at, b"")))

    def exited(self, name: str, exit_code: int) -> None:
        """Be told, on any thread, that a process has ended."""
        self._notes.put((f"{ENDED}/{name}", exit_text(exit_code).encode()))

    def await_all(self) -> None:
        """Wait until all are there."""
        deadline_s = time.monotonic() + JOIN_LIMIT_S
        while len(self._alive) < len(NAMES):
            self._handle_next()
            if time.monotonic() > deadline_s:
                sys.exit(f"expected {', '.join(NAMES)}, only {', '.join(sorted(self._alive))} joined.")

    def fly(self, n_ticks: int) -> None:
        """Let time begin, and wait until all have finished the last tick."""
        self._watchdog.moved(time.monotonic())
        self._bus.publish(control.STOP, control.TickNote(tick=n_ticks - 1).to_bytes(), urgent=True)
        self._bus.publish(control.START, b"", urgent=True)
        while not self._watchdog.are_done:
            self._handle_next()
            if fault := self._watchdog.check(time.monotonic(), is_judged=False):
                sys.exit(f"{fault.participant}: {fault.text}")
        self._bus.publish(control.CLOSE, b"", urgent=True)

    def _handle_next(self) -> None:
        try:
            key, payload = self._notes.get(timeout=LOOK_EVERY_S)
        except queue.Empty:
            return
        name, now_s = key.rsplit("/", 1)[-1], time.monotonic()
        if key == control.progress(name):
            self._watchdog.progressed(name, control.TickNote.from_bytes(payload), now_s)
        elif key == control.waiting(name):
            self._watchdog.waits(name, control.WaitingNote.from_bytes(payload))
        elif key == control.bye(name):
            self._watchdog.said_goodbye(control.Bye.from_bytes(payload), now_s)
        elif key == control.alive(name):
            self._alive.add(name)
        elif key == control.FAULT:
            note = control.FaultNote.from_bytes(payload)
            sys.exit(f"{note.participant}: {note.text}")
        else:
            sys.exit(f"{name} {payload.decode()} before the end.")


def measure(shape: str, n_ticks: int) -> dict[str, float]:
    """Run all five and return their speed."""
    with ExitStack() as stack:
        # Short: paths of sockets are limited.
        folder = Path(tempfile.mkdtemp(prefix="peers-"))
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        run_dir = RunDir.create(folder, name="ring", seed=0)
        children = stack.enter_context(Children(lambda name, exit_code, _: watch.exited(name, exit_code)))
        router = RunRouter(run_dir, Network(), folder, {}, mesh=NAMES)
        bus = stack.enter_context(router.open())
        watch = Watch(bus, run_dir)
        watch.listen()
        for name in NAMES:
            command = [sys.executable, __file__, "--shape", shape, "--ticks", str(n_ticks), "--name", name]
            children.start(name, command, join=router.join_of_service(name, is_watched=True), log=run_dir.log(name))
        watch.await_all()
        watch.fly(n_ticks)
        children.wait(EXIT_LIMIT_S)
        return {"ticks_per_s": ticks_per_s(run_dir.path, n_ticks)}


def participate(shape: str, n_ticks: int, name: str) -> None:
    """Take part as one service."""
    join = Join.from_environment()
    place = places(shape)[NAMES.index(name)]
    take_part(join, [TrivialCore(place, n_ticks, Path(str(join.run_dir)))], dataflow_of(shape), Episode(seed=0))


def main() -> None:
    """Print the speed, or be one of the five."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shape", choices=SHAPES, required=True, help="see ring.py")
    parser.add_argument("--ticks", type=int, default=2000, help="how many")
    parser.add_argument("--name", choices=NAMES, help="be this participant of the run that GSLCOSIM_JOIN leads to")
    options = parser.parse_args()
    if options.name:
        participate(options.shape, options.ticks, options.name)
    else:
        print(json.dumps(measure(options.shape, options.ticks)))  # noqa: T201


if __name__ == "__main__":
    main()
