"""Comparison of runs: where two differ first, and how one comes from the other."""

from collections.abc import Set
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.checksums import check_files
from gslcosim.base.untrusted_input import MalformedFileError
from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS
from gslcosim.runtime.digest import LINK_BYTES, HashChain, RunDigest
from gslcosim.runtime.run_dir import ForkOrigin, RunDir
from gslcosim.runtime.services import build_dataflow, get_upstream_rank
from gslcosim.scenario import Scenario

_BRIEFING_KEY_PARTS = keys.briefing("*").split("*")


@dataclass(frozen=True)
class Divergence:
    """First difference of two runs."""

    tick: int
    participant: str
    port: str
    text: str


def find_first_divergence(a: RunDigest, b: RunDigest) -> Divergence | None:
    """Return the earliest tick, and there the most upstream port, at which two runs differ; None when they are equal.

    The most upstream one is the cause, the others are its consequences.
    """
    found: list[tuple[int, tuple[int, int], Divergence]] = []
    for port in sorted({*a.trails, *b.trails}):
        writer = a.writer_of.get(port) or b.writer_of[port]
        divergence = _find_port_divergence(port, writer, a.trails.get(port), b.trails.get(port))
        if divergence:
            found.append((divergence.tick, get_upstream_rank(writer), divergence))
    if found:
        return min(found, key=lambda item: item[:2])[2]
    if a.final_tick != b.final_tick:
        tick = min(a.final_tick, b.final_tick)
        return Divergence(tick, "referee", "referee/verdict", f"one run ends at tick {tick}, the other goes on")
    return None


def _find_port_divergence(port: str, writer: str, a: HashChain | None, b: HashChain | None) -> Divergence | None:
    if a is None or b is None:
        present = a or b
        tick = present.ticks[0] if present and present.ticks else 0
        return Divergence(tick, writer, port, "only one of the runs has this port")
    n = min(len(a.ticks), len(b.ticks))
    size = n * LINK_BYTES
    if a.ticks[:n] != b.ticks[:n] or a.links[:size] != b.links[:size]:
        i = next(i for i in range(n) if a.ticks[i] != b.ticks[i] or a.link(i) != b.link(i))
        return Divergence(min(a.ticks[i], b.ticks[i]), writer, port, "the messages differ")
    if len(a.ticks) != len(b.ticks):
        longer = a if len(a.ticks) > n else b
        return Divergence(longer.ticks[n], writer, port, "only one of the runs has a message here")
    return None


def find_repeated_divergence(
    before: RunDigest,
    now: RunDigest,
    *,
    last_tick: int,
    scenarios: tuple[Scenario, Scenario],
    other: Set[str] = frozenset(),
) -> Divergence | None:
    """Return where a run first differs from the one that it repeats; None where it does not.

    Args:
        last_tick: How far it repeats the other: what that one did afterwards does not count.
        scenarios: Of the one that is repeated, and of the other: what they record may differ.
        other: Ports that may differ besides.
    """
    if scenarios[0].recording != scenarios[1].recording:
        other = other | build_dataflow(scenarios[1]).recording_ports
    return find_first_divergence(before.without(other, final_tick=last_tick), now.without(other))


@dataclass(frozen=True, kw_only=True)
class ForkRelation:
    """Relation of two runs: `fork` names the run that leaves the other at `tick` ("both": a third)."""

    fork: str
    tick: int


@dataclass(frozen=True, kw_only=True)
class RunComparison:
    """Two digests and where they part first.

    Runs that come from one another may brief their agents differently without being two runs before the fork: then
    `changed_agents` has the agents, and `divergence` is what else differs first, if anything does.
    """

    a: RunDigest
    b: RunDigest
    divergence: Divergence | None
    kinship: ForkRelation | None
    changed_agents: tuple[str, ...]

    @classmethod
    def of(cls, a: Path, b: Path) -> "RunComparison":
        """Compare the runs of two `digest.json`."""
        digests = RunDigest.load(a), RunDigest.load(b)
        kinship = _find_fork_relation(a.parent, b.parent)
        divergence = find_first_divergence(*digests)
        if kinship is None or divergence is None:
            return cls(a=digests[0], b=digests[1], divergence=divergence, kinship=kinship, changed_agents=())
        briefings = {port for digest in digests for port in digest.trails if _find_briefed_agent(port)}
        links = [{port: trail.links for port, trail in digest.trails.items()} for digest in digests]
        changed = (port for port in briefings if links[0].get(port) != links[1].get(port))
        agents = tuple(sorted(map(_find_briefed_agent, changed)))
        # A fork that had no events and has some now is the same until one of them happens.
        other = briefings | ({EVENTS} if len([1 for digest in digests if EVENTS in digest.trails]) == 1 else set[str]())
        later = find_first_divergence(*(digest.without(other) for digest in digests))
        return cls(a=digests[0], b=digests[1], divergence=later or divergence, kinship=kinship, changed_agents=agents)


def _find_fork_relation(a: Path, b: Path) -> ForkRelation | None:
    of_a, of_b = _read_origin(a), _read_origin(b)
    if of_b is not None and of_b["run"] == a.name:
        return ForkRelation(fork="b", tick=of_b["tick"])
    if of_a is not None and of_a["run"] == b.name:
        return ForkRelation(fork="a", tick=of_a["tick"])
    if of_a is not None and of_b is not None and of_a["run"] == of_b["run"]:
        return ForkRelation(fork="both", tick=min(of_a["tick"], of_b["tick"]))
    return None


# A digest may stand without its run.
def _read_origin(folder: Path) -> ForkOrigin | None:
    try:
        manifest = RunDir(folder).load_manifest()
    except MalformedFileError:
        return None
    check_files(folder, "manifest.json")
    return manifest.get("fork_of")


def _find_briefed_agent(port: str) -> str:
    before, after = _BRIEFING_KEY_PARTS
    return port[len(before) : -len(after)] if port.startswith(before) and port.endswith(after) else ""
