"""Print how many decisions per second agents give over each transport, and how long a question and its answer take.

A scripted world asks the same questions again and again, so what is measured is the validator, the link and the agent.
Run with `make bench-agents`, or `python tests/benchmarks/bench_agents.py [N_DECISIONS] [AGENT…]`, where an agent is
`python` or the name of a folder in `agents/`.
"""

import itertools
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "shared"), str(ROOT / "tests" / "kit")]

from languages import SERIES, LanguageAgent, golden_briefing, golden_observations, language_agents  # noqa: E402
from real_runs import AGENTS  # noqa: E402 - as the tests of that folder

from gslcosim.contract import codec  # noqa: E402
from gslcosim.contract.messages import Briefing, Message, Observation  # noqa: E402
from gslcosim.gateway.frame_codec import FrameFormat, encode_message  # noqa: E402
from gslcosim.runtime.agents.validator import CommandValidator  # noqa: E402
from gslcosim_conformance.scripted_world import AGENT  # noqa: E402
from gslcosim_conformance.transports import CheckTransport, ConnectionSpec  # noqa: E402

N_WARM = 50
LIMIT_S = 60.0
FRAMED = str(AGENTS / "framed.py")
BEETLE = str(ROOT / "agents" / "dung_beetle" / "agent.py")


def questions() -> Iterator[Observation]:
    """Yield the questions of the golden series for ever, at ticks that go on."""
    steps = SERIES[0]["steps"]
    for tick in itertools.count():
        (observation,) = golden_observations([steps[tick % len(steps)]])
        yield observation.model_copy(update={"tick": tick, "agent": AGENT})


def briefing() -> Briefing:
    """Return the agent's briefing."""
    return golden_briefing(1).model_copy(update={"agent": AGENT})


def through_transport(connection: ConnectionSpec, n_decisions: int) -> list[float]:
    """Return the time of each question and its answer, checked by a run's own validator [us]."""
    wire = connection.open()
    wire.start()
    try:
        wait_for(wire, "joined")
        transport = CommandValidator(AGENT)
        wire.send(Briefing, briefing().model_dump())
        times_us: list[float] = []
        for observation in itertools.islice(questions(), N_WARM + n_decisions):
            began = time.perf_counter_ns()
            transport.on_observation(observation)
            wire.send(Observation, observation.model_dump())
            commands = transport.on_answer(wait_for(wire, "command"))
            times_us.append((time.perf_counter_ns() - began) / 1000)
            wire.acknowledge()
            if [command.kind for command in commands] != ["waypoint"]:
                sys.exit(f"expected a waypoint, was {commands}: {transport.faults}")
        return times_us[N_WARM:]
    finally:
        wire.stop()


def wait_for(wire: CheckTransport, kind: str) -> bytes:
    """Return the next event's data, which must be of this kind."""
    event, data = wire.events.get(timeout=LIMIT_S)
    if event != kind:
        sys.exit(f"expected {kind}, was {event}: {data.decode(errors='replace')}")
    return data


def through_bare_pipes(frame_format: FrameFormat, n_decisions: int) -> list[float]:
    """Return the same times without any gateway: one thread that writes a frame and reads the answer [us]."""
    command = [sys.executable, FRAMED, "stdio", frame_format]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as agent:
        agent.stdin.write(frame_of(frame_format, briefing()))
        times_us: list[float] = []
        for observation in itertools.islice(questions(), N_WARM + n_decisions):
            frame = frame_of(frame_format, observation)
            began = time.perf_counter_ns()
            agent.stdin.write(frame)
            agent.stdout.read(65536)
            times_us.append((time.perf_counter_ns() - began) / 1000)
        agent.stdin.close()
        return times_us[N_WARM:]


def frame_of(frame_format: FrameFormat, message: Message) -> bytes:
    """Return a message as the gateway sends it."""
    return encode_message(frame_format, type(message).__name__, codec.encode(message))


def show(name: str, transport: str, times_us: list[float], baseline_us: float | None = None) -> float:
    """Print one line and return the median round trip [us]."""
    median_us = statistics.median(times_us)
    slowest_us = statistics.quantiles(times_us, n=100)[-1]
    rate = 1e6 / statistics.fmean(times_us)
    added = "" if baseline_us is None else f"{median_us - baseline_us:+12.0f}"
    print(f"{name:26}{transport:16}{rate:12.0f}{median_us:12.0f}{slowest_us:12.0f}{added}")  # noqa: T201
    return median_us


def bench_python(n_decisions: int) -> None:
    """Print one line for each transport of the Python dung beetle, and how much the gateway adds to bare pipes."""
    show("python, agent_kit", "zenoh", through_transport(ConnectionSpec(command=(sys.executable, BEETLE)), n_decisions))
    for frame_format in ("msgpack", "json"):
        bare_us = show("python, no gateway", f"pipes {frame_format}", through_bare_pipes(frame_format, n_decisions))
        for transport in ("stdio", "tcp", "unix"):
            command = (sys.executable, FRAMED, "stdio" if transport == "stdio" else "socket", frame_format)
            connection = ConnectionSpec(command=command, transport=transport, format=frame_format)
            show("python", f"{transport} {frame_format}", through_transport(connection, n_decisions), bare_us)


def bench_language(agent: LanguageAgent, n_decisions: int) -> None:
    """Print one line for an agent in another language, or why there is none."""
    name = agent.folder.name
    if agent.lacks or agent.is_for_soak_only:
        print(f"{name:26}skipped: {agent.lacks or 'it takes minutes to build; see its README'}")  # noqa: T201
        return
    agent.build()
    connection = ConnectionSpec(
        command=tuple(agent.started_by()), transport=agent.door, format=agent.format, observations=agent.observations
    )
    show(name, f"{agent.door} {agent.format}", through_transport(connection, n_decisions))


def main() -> None:
    """Print the table."""
    n_decisions = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    chosen = set(sys.argv[2:])
    print(f"{n_decisions} decisions each; times in us; the last column is what the gateway adds to bare pipes")  # noqa: T201
    print(f"{'agent':26}{'door':16}{'decisions/s':>12}{'median':>12}{'99 %':>12}{'added':>12}")  # noqa: T201
    if not chosen or "python" in chosen:
        bench_python(n_decisions)
    for agent in language_agents():
        if not chosen or agent.folder.name in chosen:
            bench_language(agent, n_decisions)


if __name__ == "__main__":
    main()
