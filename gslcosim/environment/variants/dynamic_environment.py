"""Dynamic environment: its variant now, while doors open and close and the wind turns."""

from gslcosim.base.errors import ModelError
from gslcosim.contract.participant import Inbox
from gslcosim.environment.model import OWN_WIND, Closed, Environment, EnvironmentVariant
from gslcosim.environment.variants.variant import find_variants, variant_after
from gslcosim.scenario.due_events import find_due_events
from gslcosim.scenario.models.scenario import Scenario


class DynamicEnvironment:
    """The room of a scenario in the situation that its events have brought.

    Whoever holds one and reads events obeys them by itself, so that all participants switch in the same tick.
    State: which doors are closed, and whose inlet makes the wind.
    """

    def __init__(self, environment: Environment, scenario: Scenario) -> None:
        """Stand as at the start of a run.

        Raises:
            ModelError: the environment lacks a room that an event brings.
        """
        self._scenario = scenario
        self._first, *later = find_variants(scenario)
        lacking = [each for each in later if each not in environment.later_rooms]
        if lacking:
            raise ModelError(f"environment: expected the room that events bring with {_text(lacking[0])}, found none.")
        self._rooms = {self._first: environment, **{each: environment.later_rooms[each] for each in later}}
        self._closed, self._i_wind = self._first.closed, OWN_WIND

    @property
    def variant(self) -> EnvironmentVariant:
        """Current variant: the closed doors, and whose inlet makes the wind."""
        return EnvironmentVariant(self._closed, self._i_wind)

    @property
    def now(self) -> Environment:
        """The room and the wind as they are now."""
        return self._rooms[self.variant]

    @property
    def rooms(self) -> dict[EnvironmentVariant, Environment]:
        """The room in all situations that it was made for."""
        return self._rooms

    def by_doors(self) -> dict[Closed, Environment]:
        """Return a room for each set of closed doors, whatever its wind; the first one first."""
        rooms = {self._first.closed: self._rooms[self._first]}
        for variant, room in self._rooms.items():
            rooms.setdefault(variant.closed, room)
        return rooms

    def reset(self) -> None:
        """Stand as at the start of a run."""
        self._closed, self._i_wind = self._first.closed, OWN_WIND

    def obey(self, inbox: Inbox) -> bool:
        """Take the events of this tick, and return whether a door has moved."""
        closed = self._closed
        for i, event in find_due_events(self._scenario, inbox):
            self._closed, self._i_wind = variant_after(self.variant, i, event)
        return self._closed != closed


def _text(variant: EnvironmentVariant) -> str:
    doors = f"{', '.join(variant.closed) or 'no door'} closed"
    return doors if variant.i_wind == OWN_WIND else f"{doors} and the wind of events[{variant.i_wind}]"
