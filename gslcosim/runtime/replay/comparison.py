"""Comparison of two runs: where they diverge, and whether one is a fork of the other."""

from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.untrusted_json import MalformedFileError
from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS
from gslcosim.runtime.digest import Divergence, RunDigest, find_first_divergence
from gslcosim.runtime.run_dir import ForkOrigin, RunDir

_BRIEFING_KEY_PARTS = keys.briefing("*").split("*")


@dataclass(frozen=True, kw_only=True)
class ForkRelation:
    """Relation of two runs: `fork` names the run that leaves the other at `tick` ("both": a third)."""

    fork: str
    tick: int


@dataclass(frozen=True, kw_only=True)
class RunComparison:
    """Two digests and where they part first.

    Runs that come from one another may brief their agents differently without being two runs before the fork: then
    `told_otherwise` has the agents, and `divergence` is what else differs first, if anything does.
    """

    a: RunDigest
    b: RunDigest
    divergence: Divergence | None
    kinship: ForkRelation | None
    told_otherwise: tuple[str, ...]

    @classmethod
    def of(cls, a: Path, b: Path) -> "RunComparison":
        """Compare the runs of two `digest.json`.

        Raises:
            UsageError: one is missing, or is no digest.
        """
        digests = RunDigest.load(a), RunDigest.load(b)
        kinship = _find_fork_relation(a.parent, b.parent)
        divergence = find_first_divergence(*digests)
        if kinship is None or divergence is None:
            return cls(a=digests[0], b=digests[1], divergence=divergence, kinship=kinship, told_otherwise=())
        briefings = {port for digest in digests for port in digest.trails if _find_briefed_agent(port)}
        agents = tuple(sorted(_find_briefed_agent(port) for port in briefings if not _are_equal(port, *digests)))
        # A fork that had no events and has some now is the same until one of them happens.
        other = briefings | ({EVENTS} if len([1 for digest in digests if EVENTS in digest.trails]) == 1 else set[str]())
        later = find_first_divergence(*(digest.without(other) for digest in digests))
        return cls(a=digests[0], b=digests[1], divergence=later or divergence, kinship=kinship, told_otherwise=agents)


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
        return RunDir(folder).load_manifest().get("fork_of")
    except MalformedFileError:
        return None


def _find_briefed_agent(port: str) -> str:
    before, after = _BRIEFING_KEY_PARTS
    return port[len(before) : -len(after)] if port.startswith(before) and port.endswith(after) else ""


def _are_equal(port: str, a: RunDigest, b: RunDigest) -> bool:
    return port in a.trails and port in b.trails and a.trails[port].links == b.trails[port].links
