"""Legs that take their time: the same seconds whatever their length."""

from collections.abc import Sequence

from gslcosim.contract.messages import Briefing, Command, Observation, Waypoint
from gslcosim.search.moving.flying import waypoint


class Pacer:
    """Gives the commands for legs, with the hold and the duration that a method's settings ask for.

    With a duration a leg is a mission with one place, which is reached no earlier than after that time.
    """

    def __init__(self, briefing: Briefing, *, hold_s: float | None = None, leg_s: float | None = None) -> None:
        """Take note of the settings.

        Args:
            briefing: The agent's.
            hold_s: How long to hold after a leg [s]; absent: as long as the briefing says.
            leg_s: The least time a leg takes [s]; absent: as fast as the vehicle flies.
        """
        self._height_m = briefing.search_height_m
        self._hold_s, self._briefed_hold_s = hold_s, briefing.hold_s
        self._leg_s = leg_s

    def leg(self, observation: Observation, end_m: Sequence[float]) -> Command:
        """Return the command for a leg to x and y, at the search height where no z is given; world frame [m]."""
        x_m, y_m, z_m = (*end_m, self._height_m)[:3]
        if self._leg_s is None:
            return waypoint(observation, x_m, y_m, z_m, hold_s=self._hold_s)
        # Only a waypoint without a hold gets the briefing's.
        hold_s = self._briefed_hold_s if self._hold_s is None else self._hold_s
        place = Waypoint(position_world_m=(x_m, y_m, z_m), hold_s=hold_s, after_s=self._leg_s)
        return Command(tick=observation.tick, kind="mission", waypoints=(place,))
