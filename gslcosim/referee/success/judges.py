"""The judges of gslcosim's own criteria; their settings are in `gslcosim.scenario.models.success`."""

from collections.abc import Sequence

from gslcosim.quantities import Vec3
from gslcosim.referee.success.criterion import Criterion, Evidence, criterion_of
from gslcosim.scenario.models.success import AllSourcesSuccess, DeclarationSuccess, MapSuccess, SourceSuccess


class SourceReached(Criterion):
    """The vehicle is within the success radius of a source; a distance equal to the radius is within it."""

    def __init__(self, success: SourceSuccess, sources_m: Sequence[Vec3]) -> None:
        del sources_m
        self._within_m = success.within_m

    def is_met(self, evidence: Evidence) -> bool:
        """Return whether the nearest source is near enough."""
        return min(evidence.distances_m) <= self._within_m


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
        self._found: set[int] = set()

    def news(self, evidence: Evidence) -> Sequence[str]:
        """Remember the sources that are near enough, and name those that are new."""
        texts: list[str] = []
        for i, distance_m in enumerate(evidence.distances_m):
            if distance_m <= self._within_m and i not in self._found:
                self._found.add(i)
                x, y, z = self._sources_m[i]
                counted = f"{len(self._found)} of {len(self._sources_m)}"
                texts.append(
                    f"comes within {distance_m:.2f} m of the source at ({x:.2f}, {y:.2f}, {z:.2f}) m: {counted}"
                )
        return texts

    def is_met(self, evidence: Evidence) -> bool:
        """Return whether no source is left."""
        del evidence
        return len(self._found) == len(self._sources_m)


class SourceMapped(Criterion):
    """The last belief has enough of its probability within the success radius of the sources."""

    def __init__(self, success: MapSuccess, sources_m: Sequence[Vec3]) -> None:
        del sources_m
        self._mass_at_least = success.mass_at_least

    def is_met(self, evidence: Evidence) -> bool:
        """Return whether there is a belief, and it is good enough."""
        return evidence.belief is not None and evidence.belief.mass_near_frac >= self._mass_at_least


criterion_of.register(SourceSuccess, SourceReached)
criterion_of.register(DeclarationSuccess, SourceDeclared)
criterion_of.register(AllSourcesSuccess, AllSourcesReached)
criterion_of.register(MapSuccess, SourceMapped)
