"""Success criteria: a source reached, declared or mapped, or all reached; `build_criterion` finds one."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import singledispatch
from typing import NamedTuple

from gslcosim.base.errors import ModelError
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import scalar_kernel
from gslcosim.contract.messages import BeliefScore, BodyState
from gslcosim.scenario.models.success import (
    AllSourcesSuccess,
    DeclarationSuccess,
    MapSuccess,
    SourceSuccess,
    SuccessSpec,
)


class Evidence(NamedTuple):
    """Evidence for a criterion at the end of a tick.

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
    """Success criterion for one agent in one run, fed with the evidence of each tick until the agent's end.

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
        """Return whether the agent has spent its only try, which ends its run as `declared`; for unmet criteria."""
        del evidence
        return False


@singledispatch
def build_criterion(success: SuccessSpec, sources_m: Sequence[Vec3]) -> Criterion:
    """Build the criterion for one agent, of the type that is registered for the block's type.

    A third party registers its own where it defines its block: `build_criterion.register(ItsBlock, ItsCriterion)`,
    where the latter is called with the block and the sources.

    Args:
        sources_m: All sources, in the scenario's order, world frame [m].

    Raises:
        ModelError: no judge is registered for such a block.
    """
    del sources_m
    raise ModelError(
        f"referee.success.of: expected a judge for {success.of!r}, found none. Register one for "
        f"{type(success).__name__} with gslcosim_services.referee.success.build_criterion."
    )


@scalar_kernel
def is_source_reached(distance_m: float, within_m: float) -> bool:
    """Return whether a source at a distance [m] is within the success radius [m], which is part of it."""
    return distance_m <= within_m


@scalar_kernel
def note_source(found: int, i_source: int, distance_m: float, within_m: float) -> int:
    """Return the sources that are found so far, a bit for each, with one added if it is within the radius [m]."""
    return found | (1 << i_source) if is_source_reached(distance_m, within_m) else found


@scalar_kernel
def is_every_source_found(found: int, n_sources: int) -> bool:
    """Return whether the bits of all sources are set."""
    return found == (1 << n_sources) - 1


class SourceReached(Criterion):
    """The vehicle is within the success radius of a source; a distance equal to the radius is within it."""

    def __init__(self, success: SourceSuccess, sources_m: Sequence[Vec3]) -> None:
        del sources_m
        self._within_m = success.within_m

    def is_met(self, evidence: Evidence) -> bool:
        """Return whether the nearest source is near enough."""
        return is_source_reached(min(evidence.distances_m), self._within_m)


class SourceDeclared(Criterion):
    """The declared place is within the success radius of a source; the first declaration decides."""

    def __init__(self, success: DeclarationSuccess, sources_m: Sequence[Vec3]) -> None:
        del sources_m
        self._within_m = success.within_m

    def is_met(self, evidence: Evidence) -> bool:
        """Return whether a place is declared that is near enough."""
        return evidence.declared_error_m is not None and evidence.declared_error_m <= self._within_m

    def has_missed(self, evidence: Evidence) -> bool:
        """Return whether a place is declared."""
        return evidence.declared_error_m is not None


class AllSourcesReached(Criterion):
    """The vehicle has been within the success radius of every source; remembers at which it has been."""

    def __init__(self, success: AllSourcesSuccess, sources_m: Sequence[Vec3]) -> None:
        self._within_m = success.within_m
        self._sources_m = tuple(sources_m)
        # A bit for each source.
        self._found = 0

    def news(self, evidence: Evidence) -> Sequence[str]:
        """Remember the sources that are near enough, and name those that are new."""
        texts: list[str] = []
        for i, distance_m in enumerate(evidence.distances_m):
            before = self._found
            self._found = note_source(before, i, distance_m, self._within_m)
            if self._found != before:
                x, y, z = self._sources_m[i]
                counted = f"{self._found.bit_count()} of {len(self._sources_m)}"
                texts.append(
                    f"comes within {distance_m:.2f} m of the source at ({x:.2f}, {y:.2f}, {z:.2f}) m: {counted}"
                )
        return texts

    def is_met(self, evidence: Evidence) -> bool:
        """Return whether no source is left."""
        del evidence
        return is_every_source_found(self._found, len(self._sources_m))


class SourceMapped(Criterion):
    """The last belief has enough of its probability within the success radius of the sources."""

    def __init__(self, success: MapSuccess, sources_m: Sequence[Vec3]) -> None:
        del sources_m
        self._mass_at_least = success.mass_at_least

    def is_met(self, evidence: Evidence) -> bool:
        """Return whether there is a belief, and it is good enough."""
        return evidence.belief is not None and evidence.belief.mass_near_frac >= self._mass_at_least


build_criterion.register(SourceSuccess, SourceReached)
build_criterion.register(DeclarationSuccess, SourceDeclared)
build_criterion.register(AllSourcesSuccess, AllSourcesReached)
build_criterion.register(MapSuccess, SourceMapped)
