"""A million ticks of the small room over separate processes: only the digests' links grow, and no tick slows."""

import itertools
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest

N_TICKS = 1_000_000
N_PARTS = 50
TICK_S = 0.1
# A link of the chain and its tick, for each port; what else a process keeps must not depend on how long it runs.
BYTES_A_TICK_AND_PORT = 16
MOST_PORTS = 3
SLACK_MB = 20
SAMPLE_EVERY_S = 1.0


def pss_mb(pid):
    return int(re.search(r"^Pss:\s+(\d+)", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.MULTILINE)[1]) / 1024


def descendants(pid):
    found = [pid]
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in task.read_text().split():
            found += descendants(int(child))
    return found


def title(pid):
    words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    return next((word.decode() for before, word in itertools.pairwise(words) if b"services" in before), "")


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
def test_a_million_ticks_take_no_more_memory_and_no_longer_ticks(tmp_path, record_testsuite_property):
    """The agent only holds; its questions divide the run into equal parts, whose durations are compared."""
    part_s = N_TICKS * TICK_S / N_PARTS
    agent = tmp_path / "holding.py"
    agent.write_text(
        "from gslcosim.agent_kit import Agent, Command, run\n\n\n"
        "class Holding(Agent):\n"
        "    def __init__(self, briefing):\n        pass\n\n"
        "    def decide(self, observation):\n"
        f"        return Command(tick=observation.tick, kind='hold', hold_s={part_s})\n\n\n"
        "if __name__ == '__main__':\n    run(Holding)\n"
    )
    changes = [
        f"agents[0].start={{python: {agent}}}",
        f"referee.stop.time_limit_s={N_TICKS * TICK_S}",
        "referee.success.within_m=0.001",
        "recording.enabled=false",
        # Filaments would gather in the room for as long as it flies: a plume in closed form is the same at all times.
        "gas={model: gaussian_plume, sources: [{position_m: [1.5, 2, 1]}]}",
    ]
    call = [sys.executable, "-m", "gslcosim", "up", "tiny_room", "--quiet", "--runs-dir", str(tmp_path / "runs")]
    process = subprocess.Popen([*call, *(word for change in changes for word in ("--set", change))])
    memory_mb, questions_at_s = {}, []
    while process.poll() is None:
        for log in (tmp_path / "runs").glob("*/inputs.log"):
            n_asked = len(log.read_text().splitlines())
            questions_at_s += [time.monotonic()] * (n_asked - len(questions_at_s))
        if questions_at_s:
            try:
                for pid in descendants(process.pid):
                    name = title(pid) or ("supervisor" if pid == process.pid else "agent")
                    memory_mb.setdefault(name, []).append((time.monotonic(), pss_mb(pid)))
            except OSError:  # it is about to end
                pass
        time.sleep(SAMPLE_EVERY_S)
    assert process.returncode == 1  # the time is up
    parts_s = [later - sooner for sooner, later in itertools.pairwise(questions_at_s)][1:-1]
    early_s, late_s = statistics.median(parts_s[:10]), statistics.median(parts_s[-10:])
    # While it flies: at the end digests are put together, and pages that were shared count for those who stay.
    flying_mb = {name: [mb for at_s, mb in series if at_s < questions_at_s[-1]] for name, series in memory_mb.items()}
    growth_mb = {
        name: max(series[-len(series) // 10 :]) - min(series[len(series) // 10 : len(series) // 5 + 1])
        for name, series in flying_mb.items()
        if len(series) > N_PARTS
    }
    record_testsuite_property("growth_mb", {name: round(growth) for name, growth in growth_mb.items()})
    record_testsuite_property("seconds_a_part", (round(early_s, 1), round(late_s, 1)))
    print({name: round(growth) for name, growth in growth_mb.items()}, early_s, late_s)  # noqa: T201
    expected_mb = N_TICKS * BYTES_A_TICK_AND_PORT * MOST_PORTS / 2**20 + SLACK_MB
    assert growth_mb
    assert all(growth < expected_mb for growth in growth_mb.values()), growth_mb
    assert late_s < 1.5 * early_s
