"""An agent that takes half a second for each decision and looks at everything."""

import time

from gslcosim.agent_kit import Agent, Command, run


class SlowListener(Agent):
    """Goes between two places, and sees every observation."""

    def __init__(self, briefing):
        self.n_asked = self.n_seen = 0

    def observe(self, observation):
        self.n_seen += 1

    def decide(self, observation):
        self.n_asked += 1
        time.sleep(0.5)
        x_m = 4.5 if self.n_asked % 2 else 4.0
        return Command(tick=observation.tick, kind="waypoint", position_world_m=(x_m, 2.5, 1.0))


if __name__ == "__main__":
    run(SlowListener)
