"""Commands as search methods give them."""

from collections.abc import Sequence

from gslcosim.contract.messages import Belief, Command, Declaration, Observation, RadioMessage


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
    """Return the command to fly to a place, world frame [m], and hold there (absent: as long as the briefing says)."""
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
