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

from gslcosim.base.processes import describe_exit
from gslcosim.bus.interface import Bus, JoinData
from gslcosim.contract.messages import Message
from gslcosim.contract.participant import Episode, Inbox, Outbox, ParticipantSpec, Read, Write
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.distributed.process_launch import RunRouter
from gslcosim.runtime.distributed.service_main import host_cores
from gslcosim.runtime.distributed.watchdog import Watchdog
from gslcosim.runtime.network import JOIN_TIMEOUT_S, Network
from gslcosim.runtime.processes.child_processes import EXIT_TIMEOUT_S, ChildProcesses
from gslcosim.runtime.run_dir import RunDir

LOOK_EVERY_S = 0.1
ENDED = "ended"


class TextMessage(Message):
    """What a participant says at a tick."""

    text: str


def spec_of(place: Place) -> ParticipantSpec:
    """Return the dataflow of a participant."""
    reads = (Read(port=f"ring/{place.reads}", delay_ticks=place.delay_ticks),) if place.reads else ()
    return ParticipantSpec(
        name=place.name, reads=reads, writes=(Write(port=f"ring/{place.name}", message_type=TextMessage),)
    )


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
        received = next((message.text for message in inbox.values() if isinstance(message, TextMessage)), "")
        text = self._participant.step(tick, received)
        if tick == self._n_ticks - 1:
            self._participant.save_times(self._folder)
        return {f"ring/{self.spec.name}": TextMessage(tick=tick, text=text)}


class Watch:
    """What the supervisor of a run does where nothing is simulated: waits for all, starts them, sees them finish."""

    def __init__(self, bus: Bus, run_dir: RunDir) -> None:
        self._bus = bus
        self._watchdog = Watchdog([(name,) for name in NAMES], run_dir)
        self._notes: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        self._alive: set[str] = set()

    def listen(self) -> None:
        """Hear participants from now on."""
        for key in (
            protocol.build_progress_key("*"),
            protocol.build_final_report_key("*"),
            protocol.FAULT_KEY,
        ):
            self._bus.subscribe(key, lambda at, payload: self._notes.put((at, payload)))
        self._bus.watch_alive(protocol.build_liveliness_key("*"), lambda at, _: self._notes.put((at, b"")))

    def exited(self, name: str, exit_code: int) -> None:
        """Be told, on any thread, that a process has ended."""
        self._notes.put((f"{ENDED}/{name}", describe_exit(exit_code).encode()))

    def await_all(self) -> None:
        """Wait until all are there."""
        deadline_s = time.monotonic() + JOIN_TIMEOUT_S
        while len(self._alive) < len(NAMES):
            self._handle_next()
            if time.monotonic() > deadline_s:
                sys.exit(f"expected {', '.join(NAMES)}, only {', '.join(sorted(self._alive))} joined.")

    def fly(self, n_ticks: int) -> None:
        """Let time begin, and wait until all have finished the last tick."""
        self._watchdog.moved(time.monotonic())
        self._bus.publish(protocol.STOP_KEY, protocol.TickReport(tick=n_ticks - 1).to_bytes(), urgent=True)
        self._bus.publish(protocol.START_KEY, b"", urgent=True)
        while not self._watchdog.is_finished:
            self._handle_next()
            if fault := self._watchdog.check(time.monotonic(), is_judged=False, look=list):
                sys.exit(f"{fault.participant}: {fault.text}")
        self._bus.publish(protocol.CLOSE_KEY, b"", urgent=True)

    def _handle_next(self) -> None:
        try:
            key, payload = self._notes.get(timeout=LOOK_EVERY_S)
        except queue.Empty:
            return
        name, now_s = key.rsplit("/", 1)[-1], time.monotonic()
        if key == protocol.build_progress_key(name):
            self._watchdog.record_progress(name, protocol.TickReport.from_bytes(payload), now_s)
        elif key == protocol.build_final_report_key(name):
            self._watchdog.record_final_report(protocol.FinalReport.from_bytes(payload), now_s)
        elif key == protocol.build_liveliness_key(name):
            self._alive.add(name)
        elif key == protocol.FAULT_KEY:
            note = protocol.FaultReport.from_bytes(payload)
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
        children = stack.enter_context(ChildProcesses(lambda name, exit_code, _: watch.exited(name, exit_code)))
        router = RunRouter(run_dir, Network(), folder, {}, mesh=NAMES)
        bus = stack.enter_context(router.open())
        watch = Watch(bus, run_dir)
        watch.listen()
        for name in NAMES:
            command = [sys.executable, __file__, "--shape", shape, "--ticks", str(n_ticks), "--name", name]
            children.start(name, command, join=router.join_of_service(name, is_watched=True), log=run_dir.log(name))
        watch.await_all()
        watch.fly(n_ticks)
        children.wait(EXIT_TIMEOUT_S)
        return {"ticks_per_s": ticks_per_s(run_dir.path, n_ticks)}


def participate(shape: str, n_ticks: int, name: str) -> None:
    """Take part as one service."""
    join = JoinData.from_environment()
    place = places(shape)[NAMES.index(name)]
    host_cores(join, [TrivialCore(place, n_ticks, Path(str(join.run_dir)))], dataflow_of(shape), Episode(seed=0))


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
