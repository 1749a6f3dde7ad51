"""Commands of search methods: waypoints, declarations, and legs with a fixed duration."""

from collections.abc import Sequence

from gslcosim.contract.messages import Belief, Briefing, Command, Declaration, Observation, RadioMessage, Waypoint


def waypoint(
    observation: Observation,
    x_m: float,
    y_m: float,
    z_m: float,
    *,
    hold_s: float | None = None,
    outgoing: Sequence[RadioMessage] = (),
    belief: Belief | None = None,
) -> Command:
    """Return the command to go to a place, world frame [m], and hold there (absent: for the briefing's time)."""
    return Command(
        tick=observation.tick,
        kind="waypoint",
        position_world_m=(float(x_m), float(y_m), float(z_m)),
        hold_s=hold_s,
        outgoing=tuple(outgoing),
        belief=belief,
    )


def declaration(
    observation: Observation,
    position_m: Sequence[float],
    confidence: float,
    *,
    belief: Belief | None = None,
) -> Command:
    """Return the command that declares the source at a place, world frame [m], with a confidence clipped to [0, 1]."""
    x_m, y_m, z_m = position_m
    return Command(
        tick=observation.tick,
        kind="declare_source",
        declaration=Declaration(
            position_world_m=(float(x_m), float(y_m), float(z_m)), confidence=min(1.0, max(0.0, float(confidence)))
        ),
        belief=belief,
    )


class LegCommander:
    """Builds commands for legs, with the hold and the duration of a method's settings.

    With a duration a leg is a mission with one waypoint, which is reached no earlier than after that time.
    """

    def __init__(self, briefing: Briefing, *, hold_s: float | None = None, leg_s: float | None = None) -> None:
        """Store the settings.

        Args:
            hold_s: Hold after a leg [s]; absent: the briefing's.
            leg_s: Least duration of a leg [s]; absent: as short as the vehicle's limits allow.
        """
        self._height_m = briefing.search_height_m
        self._hold_s, self._briefed_hold_s = hold_s, briefing.hold_s
        self._leg_s = leg_s

    def leg(self, observation: Observation, end_m: Sequence[float]) -> Command:
        """Return the command for a leg to x and y, at the search height without a z; world frame [m]."""
        x_m, y_m, z_m = (*end_m, self._height_m)[:3]
        if self._leg_s is None:
            return waypoint(observation, x_m, y_m, z_m, hold_s=self._hold_s)
        # Only a waypoint without a hold gets the briefing's.
        hold_s = self._briefed_hold_s if self._hold_s is None else self._hold_s
        place = Waypoint(position_world_m=(x_m, y_m, z_m), hold_s=hold_s, after_s=self._leg_s)
        return Command(tick=observation.tick, kind="mission", waypoints=(place,))
