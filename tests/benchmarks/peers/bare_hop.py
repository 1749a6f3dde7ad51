"""Two processes of a run send each other 200 bytes over its bus, and two by unix datagrams; prints both as JSON.

    python tests/benchmarks/peers/bare_hop.py --n 5000

Router, accounts and links between services are those of a run; nothing is encoded, digested or stepped. Both are done
in turns, and a hop is half of the median of a turn there and back.
"""

import argparse
import json
import os
import queue
import shutil
import socket
import statistics
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from gslcosim.bus.interface import JoinData
from gslcosim.bus.zenoh_bus import ZenohBus
from gslcosim.runtime.distributed.process_launch import RunRouter
from gslcosim.runtime.network import Network
from gslcosim.runtime.processes.child_processes import ChildProcesses
from gslcosim.runtime.run_dir import RunDir

PAYLOAD = bytes(200)
NAMES = ("here", "there")
LIMIT_S = 30.0


def over_datagram(n: int) -> list[float]:
    """Return how long each turn over a unix datagram takes [s].

    Each process has a core of its own, as the services of a run have; on one core a turn takes a tenth.
    """
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    cores = sorted(os.sched_getaffinity(0))
    pid = os.fork()
    os.sched_setaffinity(0, {cores[0 if pid == 0 else -1]})
    if pid == 0:
        for _ in range(n):
            theirs.send(theirs.recv(1024))
        os._exit(0)
    taken_s = []
    for _ in range(n):
        began = time.perf_counter()
        ours.send(PAYLOAD)
        ours.recv(1024)
        taken_s.append(time.perf_counter() - began)
    os.waitpid(pid, 0)
    os.sched_setaffinity(0, cores)
    return taken_s


def answer() -> None:
    """Be the other process: send back what comes."""
    arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    with ZenohBus.open_member(JoinData.from_environment()) as bus:
        bus.subscribe("hop/here", lambda _, payload: arrived.put(payload))
        while payload := arrived.get(timeout=LIMIT_S):
            bus.publish("hop/there", payload)


def over_bus(n: int) -> list[float]:
    """Return how long each turn over the bus of a run takes [s]."""
    with ExitStack() as stack:
        folder = Path(tempfile.mkdtemp(prefix="hop-"))
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        run_dir = RunDir.create(folder, name="hop", seed=0)
        router = RunRouter(run_dir, Network(), folder, {}, mesh=NAMES)
        stack.enter_context(router.open())
        children = stack.enter_context(ChildProcesses(lambda *_: None))
        bus = stack.enter_context(ZenohBus.open_member(router.join_of_service("here", is_watched=True)))
        arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        bus.subscribe("hop/there", lambda _, payload: arrived.put(payload))
        join = router.join_of_service("there", is_watched=True)
        children.start("there", [sys.executable, __file__, "--answer"], join=join, log=run_dir.log("there"))
        # It may not be there yet.
        deadline = time.monotonic() + LIMIT_S
        while time.monotonic() < deadline:
            bus.publish("hop/here", PAYLOAD)
            try:
                arrived.get(timeout=0.1)
                break
            except queue.Empty:
                continue
        taken_s = []
        for _ in range(n):
            began = time.perf_counter()
            bus.publish("hop/here", PAYLOAD)
            arrived.get(timeout=LIMIT_S)
            taken_s.append(time.perf_counter() - began)
        bus.publish("hop/here", b"")
        return taken_s


def main() -> None:
    """Print the hops, or be the other process."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=3000, help="turns of each")
    parser.add_argument("--rounds", type=int, default=3, help="how often both are done")
    parser.add_argument("--answer", action="store_true", help="be the other process")
    options = parser.parse_args()
    if options.answer:
        answer()
        return
    datagram_us, bus_us = [], []
    for _ in range(options.rounds):
        datagram_us.append(statistics.median(over_datagram(options.n)) / 2 * 1e6)
        bus_us.append(statistics.median(over_bus(options.n)) / 2 * 1e6)
    print(json.dumps({"bus_us": bus_us, "datagram_us": datagram_us}))  # noqa: T201


if __name__ == "__main__":
    main()
