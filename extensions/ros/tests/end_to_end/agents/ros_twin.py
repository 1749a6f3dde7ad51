"""Decides by its pose and its nose alone, as the node of ROS 2 that it is compared with."""

import math

from gslcosim.agent_kit import Agent, Command, run


def choose_target(position_m, response):
    """Return where to fly next from a position, by a sensor's response: another last bit goes elsewhere."""
    x, y, _ = position_m
    turn_rad = 1000.0 * response
    return x + 0.3 * math.cos(turn_rad), y + 0.3 * math.sin(turn_rad), 1.2


class RosTwin(Agent):
    """Goes where the rule says."""

    def __init__(self, briefing):
        del briefing

    def decide(self, observation):
        """Fly on, by what the nose reports."""
        target_m = choose_target(observation.position_world_m, observation.reading("nose").values[0])
        return Command(tick=observation.tick, kind="waypoint", position_world_m=target_m)


if __name__ == "__main__":
    run(RosTwin)
