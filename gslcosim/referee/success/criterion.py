"""What a judge of success is, and how it is found for the block of a scenario."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch

from gslcosim.contract.messages import BeliefScore, BodyState
from gslcosim.errors import ModelError
from gslcosim.quantities import Vec3
from gslcosim.scenario.models.success import SuccessSpec


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What a criterion judges at the end of a tick.

    `time_s` is the simulated time; `body` is the agent's vehicle; `distances_m` are those from it to each source, in
    the scenario's order, in the plane where heights do not count [m]; `declared_error_m` is how far the place that the
    agent declares in this tick is from the nearest source [m], None where it declares none; `belief` are the figures of
    the last belief it sent, if any.
    """

    time_s: float
    body: BodyState
    distances_m: tuple[float, ...]
    declared_error_m: float | None = None
    belief: BeliefScore | None = None


class Criterion(ABC):
    """Judges one agent in one run, fed with the evidence of each tick until the agent's end.

    Evidence of ticks in which the agent failed, collided or left the room is not shown to it. It may keep what it has
    seen, and draws no random numbers.
    """

    def news(self, evidence: Evidence) -> Sequence[str]:
        """Take note of a tick and return what progress it brought, sentences without their subject; called first."""
        del evidence
        return ()

    @abstractmethod
    def is_met(self, evidence: Evidence) -> bool:
        """Return whether the agent has succeeded."""

    def has_missed(self, evidence: Evidence) -> bool:
        """Return whether the agent has spent its only try, which ends its run as `declared`; asked if it is not met."""
        del evidence
        return False


@singledispatch
def criterion_of(success: SuccessSpec, sources_m: Sequence[Vec3]) -> Criterion:
    """Return a new judge for one agent, of the type that is registered for the block's type.

    A third party registers its own where it defines its block: `criterion_of.register(ItsBlock, ItsCriterion)`, where
    the latter is called with the block and the sources.

    Args:
        success: The scenario's block.
        sources_m: All sources, in the scenario's order, world frame [m].

    Raises:
        ModelError: no judge is registered for such a block.
    """
    del sources_m
    raise ModelError(
        f"referee.success.of: expected a judge for {success.of!r}, found none. Register one for "
        f"{type(success).__name__} with gslcosim.referee.success.criterion_of."
    )
