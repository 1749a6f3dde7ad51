"""Flies up the wind, and around what its four range finders see; nothing but them keeps it from walls."""

import math

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run

SPEED_M_S = 0.4
NEAR_M = 0.7
# Where the beams look: the vehicle goes on to look along +x. Front, left, back, right.
DIRECTIONS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))


class Beams(Agent):
    """Goes straight up the wind; before an obstacle it turns to the side with more room until the way is clear."""

    def __init__(self, briefing: Briefing) -> None:
        self.side: int | None = None
        self.last_blocked_m = (0.0, 0.0)

    def decide(self, observation: Observation) -> Command:
        """Return the velocity until the next question."""
        ranges_m = observation.reading("beams").values
        _, upwind_rad = observation.reading("wind").values
        ahead = round(upwind_rad / (math.pi / 2)) % 4
        here_m = observation.position_world_m[:2]
        if ranges_m[ahead] < NEAR_M:
            self.last_blocked_m = here_m
            if self.side is None or ranges_m[self.side] < NEAR_M:
                self.side = max((ahead + 1) % 4, (ahead - 1) % 4, key=lambda beam: ranges_m[beam])
        elif math.dist(here_m, self.last_blocked_m) > NEAR_M:  # the whole vehicle is past the edge
            self.side = None
        x, y = DIRECTIONS[ahead if self.side is None else self.side]
        velocity = (SPEED_M_S * x, SPEED_M_S * y, 0.0)
        return Command(tick=observation.tick, kind="velocity", velocity_world_m_s=velocity)


if __name__ == "__main__":
    run(Beams)
