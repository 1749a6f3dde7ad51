"""One run over links of all kinds: how fast it is, what was asked for again, and whether the digest is the same.

    make soak-network
    python tests/soak/network_campaign.py --ticks 2000 --windows 256 --only 100

World, referee, recorder and agent are on one host, fields and sensing on another: network namespaces of this machine,
with a wire between them that delays, loses, reorders and cuts packets (`tests/end_to_end/lossy_link.py`). Linux, as
root.
In an open run the agent decides once; in a closed one it is the dung beetle, and all wait for it at its waypoints.
"""

import argparse
import contextlib
import platform
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "end_to_end"), str(ROOT / "tests" / "shared")]

from lossy_link import Quality, Tally  # noqa: E402
from real_runs import TINY_ROOM, Ended, fly_here, start, wait_a_moment  # noqa: E402 - test folders are no packages
from two_hosts import CONGESTION_CONTROL, HERE, two_hosts, why_not  # noqa: E402

WINDOWS_TICKS = (256, 1024, 4096)
N_TICKS = 6000
TICK_S = 0.1
# Into the run, so that queues are full.
CUT_AFTER_S = 1.0
FLIGHT_LIMIT_S = 900.0


@dataclass(frozen=True, kw_only=True)
class Link:
    """A link: its name, what its wire does (a cable where that is absent), and for how long it is cut."""

    name: str
    quality: Quality | None = None
    cut_s: float = 0.0
    congestion_control: str = CONGESTION_CONTROL


_BAD = Quality(delay_s=0.1, loss_frac=0.05, reorder_frac=0.05)
LINKS = (
    Link(name="cable"),
    Link(name="5 ms", quality=Quality(delay_s=0.005)),
    Link(name="20 ms", quality=Quality(delay_s=0.02)),
    Link(name="100 ms", quality=Quality(delay_s=0.1)),
    Link(name="100 ms, cut for 3 s", quality=Quality(delay_s=0.1), cut_s=3.0),
    Link(name="100 ms, 5 % lost, 5 % reordered", quality=_BAD),
    Link(name="100 ms, 5 % lost, 5 % reordered, cut for 3 s", quality=_BAD, cut_s=3.0),
    Link(name="the same with BBR", quality=_BAD, cut_s=3.0, congestion_control="bbr"),
)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A run over a link."""

    link: Link
    is_open: bool
    window_ticks: int
    n_ticks: int


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What came of a case; `problem` is empty where the digest is that of one host."""

    case: Case
    rate_hz: float = 0.0
    flight_s: float = 0.0
    n_resends: int = 0
    lost: int = 0
    n_bytes: int = 0
    problem: str = ""


class Digests:
    """The digests on one host, by what decides them."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, ...], str] = {}

    def of(self, changes: tuple[str, ...]) -> str:
        if changes not in self._known:
            folder = Path(tempfile.mkdtemp(prefix="gn", dir="/tmp"))
            self._known[changes] = fly_here(TINY_ROOM, folder, *changes).result["digest"]
            shutil.rmtree(folder)
        return self._known[changes]


def changes_of(case: Case, agent: Path) -> tuple[str, ...]:
    """Return what makes the small room's scenario that of a case."""
    if not case.is_open:
        return ()
    settings = (f"agents[0].start={{python: {agent}}}", f"referee.stop.time_limit_s={case.n_ticks * TICK_S}")
    return tuple(word for setting in settings for word in ("--set", setting))


def holding_agent(folder: Path, hold_s: float) -> Path:
    """Write an agent that decides once: to stay where it is for the whole run."""
    path = folder / "holding_once.py"
    path.write_text(
        "from gslcosim.agent_kit import Agent, Command, run\n\n\n"
        "class HoldingOnce(Agent):\n"
        "    def __init__(self, briefing):\n        pass\n\n"
        "    def decide(self, observation):\n"
        f"        return Command(tick=observation.tick, kind='hold', hold_s={hold_s})\n\n\n"
        "if __name__ == '__main__':\n    run(HoldingOnce)\n"
    )
    return path


def fly(case: Case, agent: Path, digests: Digests) -> Flown:
    """Run a case."""
    changes = changes_of(case, agent)
    expected = digests.of(changes)
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="gn", dir="/tmp")))
        hosts = stack.enter_context(two_hosts(case.link.quality, congestion_control=case.link.congestion_control))
        flight = start(
            TINY_ROOM, folder / "runs", *changes, "--elsewhere=fields,sensing", f"--listen=tcp/{HERE}:7447",
            "--insecure", f"--join-dir={folder / 'join'}", f"--window-ticks={case.window_ticks}",
            prefix=hosts.run_here,
        )  # fmt: skip
        stack.callback(flight.abandon)
        file = folder / "join" / "services" / "fields.json"
        joined = hosts.start_there("join", "--wait=60", file, "fields", "sensing", "--quiet", cwd=folder)
        stack.callback(joined.communicate)
        stack.callback(joined.kill)
        if case.link.cut_s and hosts.wire is not None:
            flight.wait_until_flying(limit_s=180)
            _wait_s(CUT_AFTER_S)
            hosts.wire.cut(case.link.cut_s)
        ended = flight.end(FLIGHT_LIMIT_S)
        joined.wait(timeout=30)
    return _flown(case, ended, expected, Tally() if hosts.wire is None else hosts.wire.tally)


def _wait_s(duration_s: float) -> None:
    until_s = time.monotonic() + duration_s
    while time.monotonic() < until_s:
        wait_a_moment()


def _flown(case: Case, ended: Ended, expected: str, tally: Tally) -> Flown:
    result = ended.result
    problem = "" if result.get("digest") == expected else f"digest {result.get('digest')}, {result.get('faults')}"
    seconds = result.get("flight_wall_s", 0.0) or 1e-9
    resends = sum(timing.get("n_resends", 0) for timing in result.get("timing", {}).values())
    n_ticks = result.get("sim_time_s", 0.0) / TICK_S
    return Flown(
        case=case,
        rate_hz=n_ticks / seconds,
        flight_s=seconds,
        n_resends=resends,
        lost=tally.lost + tally.cut,
        n_bytes=tally.bytes,
        problem=problem,
    )


def row_of(flown: Flown) -> str:
    """Return a row of the table."""
    case = flown.case
    kind = "open" if case.is_open else "closed"
    digest = "same" if not flown.problem else f"**other**: {flown.problem}"
    return (
        f"| {case.link.name} | {kind} | {case.window_ticks} | {flown.rate_hz:.0f} | {flown.flight_s:.1f} | "
        f"{flown.n_resends} | {flown.n_bytes / 1e6:.1f} | {flown.lost} | {digest} |"
    )


def cases_of(windows_ticks: tuple[int, ...], n_ticks: int, only: str) -> list[Case]:
    """Return the cases whose link has a word in its name: open runs with each window, and a closed one."""
    cases: list[Case] = []
    for link in LINKS:
        if only in link.name:
            plans = [(True, window) for window in windows_ticks] + [(False, windows_ticks[0])]
            cases += [Case(link=link, is_open=o, window_ticks=w, n_ticks=n_ticks) for o, w in plans]
    return cases


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main(words: list[str] | None = None) -> int:
    """Fly all cases, print the table, and return 1 where a digest was another."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=N_TICKS, help="length of an open run")
    parser.add_argument("--windows", type=int, nargs="+", default=list(WINDOWS_TICKS), metavar="TICKS")
    parser.add_argument("--only", default="", metavar="WORD", help="links with a word in their name")
    arguments = parser.parse_args(words)
    if reason := why_not(needs_wire=True):
        _say(f"Not flown: {reason}.")
        return 0
    _say(f"{datetime.now(UTC):%Y-%m-%d}, {platform.system()} {platform.release()}, {arguments.ticks} ticks\n")
    _say("| link, each way | run | window [ticks] | ticks/s | flight [s] | resends | MB | packets lost | digest |")
    _say("|---|---|---|---|---|---|---|---|---|")
    digests, n_wrong = Digests(), 0
    with tempfile.TemporaryDirectory(prefix="gn", dir="/tmp") as folder:
        agent = holding_agent(Path(folder), arguments.ticks * TICK_S)
        for case in cases_of(tuple(arguments.windows), arguments.ticks, arguments.only):
            flown = fly(case, agent, digests)
            n_wrong += bool(flown.problem)
            _say(row_of(flown))
    return 1 if n_wrong else 0


if __name__ == "__main__":
    sys.exit(main())
