"""Success criteria: a block for each, with the task of agents and the goal in recordings.

The blocks hold settings and words. `gslcosim_services.referee.success` decides by them.
"""

from abc import abstractmethod
from typing import Annotated, ClassVar, Literal

from pydantic import Field, SerializeAsAny

from gslcosim.base.plugins import EntryPoints
from gslcosim.scenario.models.base import OneOf, Positive, Spec

# Entry points of other packages' criteria; each is a class that derives from `SuccessSpec`.
SUCCESS_ENTRY_POINTS = "gslcosim.success"
DEFAULT_CRITERION = "source"


class SuccessSpec(Spec):
    """Base of all criteria: `of` names the criterion, `within_m` is the success radius [m].

    Beliefs are scored with the same radius, whatever the criterion. A criterion of another package derives from this
    class, narrows `of` to its name, and gives its task as a sentence and as fields of `Task` in the briefing.
    """

    distance_of: ClassVar[Literal["vehicle", "declaration", "belief"] | None] = None
    asks_for_declaration: ClassVar[bool] = False
    n_sources: ClassVar[int | None] = 1
    # The sentence, without its subject, that reports the success of an agent.
    met_text: ClassVar[str] = "has found the source"

    within_m: Positive = Field(default=1.0, description="success radius")
    of: str = Field(description="criterion")

    @property
    def is_horizontal(self) -> bool:
        """True if heights do not count in distances to sources."""
        return False

    @property
    def reach_m(self) -> float | None:
        """Distance to a source that the shortest sufficient path has to reach [m].

        0: to the source itself, if nothing has to be approached. None: the path to one source is not sufficient, and no
        shortest path is reported.
        """
        return 0.0

    @property
    def drawn_radius_m(self) -> float | None:
        """Radius drawn around each source [m]; None draws nothing. If heights do not count it is a column."""
        return self.within_m

    @abstractmethod
    def task_text(self, gas: str) -> str:
        """Return the agent's task as the beginning of a sentence, whose end is a time limit."""

    @property
    @abstractmethod
    def summary_text(self) -> str:
        """Goal of the run, in a few words for the recording."""


class _PlaceSpec(SuccessSpec):
    horizontal: bool = Field(default=False, description="ignore height in distances")

    @property
    def is_horizontal(self) -> bool:
        return self.horizontal

    @property
    def _in_the_plane(self) -> str:
        return " in the plane" if self.horizontal else ""


class SourceSuccess(_PlaceSpec):
    """The vehicle is within `within_m` of a source.

    With `horizontal` heights do not count: distances are those in the plane.
    """

    distance_of = "vehicle"
    of: Literal["source"] = "source"  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def reach_m(self) -> float | None:
        """The success radius: the run ends there, and so does the shortest path."""
        return self.within_m

    def task_text(self, gas: str) -> str:
        """Return the agent's task."""
        return f"Find the source of {gas} in the room: come within {self.within_m:g} m of it{self._in_the_plane}"

    @property
    def summary_text(self) -> str:
        """Goal of the run."""
        return f"vehicle within {self.within_m:g} m of a source{self._in_the_plane}"


class DeclarationSuccess(_PlaceSpec):
    """The place that the agent declares is within `within_m` of a source; a wrong declaration ends its run.

    With `horizontal` heights do not count: distances are those in the plane.
    """

    distance_of = "declaration"
    asks_for_declaration = True
    of: Literal["declaration"] = "declaration"  # pyright: ignore[reportIncompatibleVariableOverride]

    def task_text(self, gas: str) -> str:
        """Return the agent's task."""
        what = f"declare a position within {self.within_m:g} m of it{self._in_the_plane}"
        return f"Find the source of {gas} in the room: {what}"

    @property
    def summary_text(self) -> str:
        """Goal of the run."""
        return f"declaration within {self.within_m:g} m of a source{self._in_the_plane}"


class AllSourcesSuccess(_PlaceSpec):
    """The vehicle has been within `within_m` of every source, in any order; each agent for itself.

    With `horizontal` heights do not count: distances are those in the plane. Agents do not receive the number of
    sources.
    """

    distance_of = "vehicle"
    n_sources = None
    met_text = "has found all sources"
    of: Literal["all_sources"] = "all_sources"  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def reach_m(self) -> float | None:
        """None: the shortest tour of all sources is not computed."""
        return None

    def task_text(self, gas: str) -> str:
        """Return the agent's task."""
        return f"Find all sources of {gas} in the room: come within {self.within_m:g} m of each{self._in_the_plane}"

    @property
    def summary_text(self) -> str:
        """Goal of the run."""
        return f"vehicle once within {self.within_m:g} m of each source{self._in_the_plane}"


class MapSuccess(SuccessSpec):
    """The agent's last belief gives the places within `within_m` of a source a probability of `mass_at_least`.

    A belief with two axes is judged in the plane. An agent that sends no beliefs cannot succeed.
    """

    distance_of = "belief"
    met_text = "has mapped the source"
    of: Literal["map"] = "map"  # pyright: ignore[reportIncompatibleVariableOverride]
    mass_at_least: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.5, description="minimum probability within the success radius in the last belief"
    )

    def task_text(self, gas: str) -> str:
        """Return the agent's task."""
        what = f"a belief with a probability of at least {self.mass_at_least:g} within {self.within_m:g} m of it"
        return f"Find the source of {gas} in the room: send {what}"

    @property
    def summary_text(self) -> str:
        """Goal of the run."""
        return f"belief with at least {self.mass_at_least:g} within {self.within_m:g} m of a source"


_OWN = {
    str(block.model_fields["of"].default): block
    for block in (SourceSuccess, DeclarationSuccess, AllSourcesSuccess, MapSuccess)
}
CRITERIA = tuple(_OWN)
"""The names of gslcosim's own criteria."""

# Selected by `of`; by default the vehicle's distance to a source.
Success = Annotated[
    SerializeAsAny[SuccessSpec],
    OneOf(
        tag_key="of",
        base=SuccessSpec,
        own=_OWN,
        offers=EntryPoints(group=SUCCESS_ENTRY_POINTS, what="criterion"),
        default=DEFAULT_CRITERION,
    ),
]
