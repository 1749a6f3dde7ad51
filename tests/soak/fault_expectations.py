"""What is right after each fault of the campaign: for every signal, member and phase, as a table."""

from dataclasses import dataclass

SERVICES = ("world", "fields", "sensing", "referee", "recorder")
AGENTS = ("agent on the bus", "agent behind stdio")
MEMBERS = (*SERVICES, *AGENTS, "fork_server", "supervisor")
SIGNALS = ("killed", "stopped 1-3 s", "stopped 8-60 s", "stopped for ever")
PHASES = ("before join", "start", "flight", "ending")

# What a run can come to.
GOES_ON = "goes on"  # exit code and digest are those of a run without a fault
NAMED = "named"  # exit code 3, not valid, the first fault names the member and says killed or stopped
AGENT_FAILED = "agent failed"  # exit code 1, valid, agent_failed, the first fault names the agent
TAKEN_ALONG = "taken along"  # the supervisor cannot say anything any more; nothing it has started is left


@dataclass(frozen=True)
class Rule:
    """For whom, after which signal and in which phase; an empty tuple stands for all. The first that fits counts."""

    members: tuple[str, ...]
    signals: tuple[str, ...]
    phases: tuple[str, ...]
    outcomes: tuple[str, ...]

    def fits(self, member: str, signal: str, phase: str) -> bool:
        """Return whether the rule speaks of this fault."""
        asked = zip((self.members, self.signals, self.phases), (member, signal, phase), strict=True)
        return all(not words or word in words for words, word in asked)


RULES = (
    # A supervisor that goes on finds its run as it was, however long it stood still.
    Rule(("supervisor",), ("killed", "stopped for ever"), (), (TAKEN_ALONG,)),
    Rule(("supervisor",), (), (), (GOES_ON,)),
    # Who goes on in time changes nothing.
    Rule((), ("stopped 1-3 s",), (), (GOES_ON,)),
    # At the end a member may have done its part.
    Rule(AGENTS, (), ("ending",), (GOES_ON, AGENT_FAILED)),
    Rule((), (), ("ending",), (GOES_ON, NAMED)),
    Rule(AGENTS, (), (), (AGENT_FAILED,)),
    # Nobody needs it while a run flies: a short run is over before it is certain that it stays stopped.
    Rule(("fork_server",), ("stopped 8-60 s", "stopped for ever"), (), (NAMED, GOES_ON)),
    Rule((), (), (), (NAMED,)),
)


def expected(member: str, signal: str, phase: str) -> tuple[str, ...]:
    """Return what a run may come to after a fault."""
    return next(rule.outcomes for rule in RULES if rule.fits(member, signal, phase))
