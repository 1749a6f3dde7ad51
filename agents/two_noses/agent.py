"""Two noses: turns to the side with more gas and flies ahead; it needs no wind.

After Chasing Ghosts (2026), with its known faults mended. README.md beside this file has the rules.
"""

import math

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search import elementary
from gslcosim_search.elementary import norm2
from gslcosim_search.reactive.reactive_searcher import ReactiveAgent
from gslcosim_search.reactive.spirals import random_side
from gslcosim_search.reactive.taxis import TwoNoses, bearing_rad, turn_rad
from gslcosim_search.senses.stop_and_measure import Contact


class TwoNosesAgent(ReactiveAgent):
    """Remembers its heading, the side of the last gas, and for how many steps there was none."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        s = self.settings
        self.noses = TwoNoses(briefing, sample_s=s.sample_s, window_s=s.window_s, threshold_ppm=s.threshold_ppm)
        self.straight_rad, self.half_rad = math.radians(s.straight_deg), math.radians(s.half_deg)
        self.heading_rad = 0.0
        self.side = random_side(self.draws)
        self.n_without = s.give_up_steps  # as if the gas had been lost long ago
        self.has_turned = False

    def observe(self, observation: Observation) -> None:
        """Watch both noses at every tick."""
        super().observe(observation)
        self.noses.add(observation)

    @property
    def may_abort(self) -> bool:
        """True if gas ends a leg that is under way."""
        return self.n_without >= self.settings.give_up_steps

    def next_step(self, observation: Observation, contact: Contact) -> Command:
        """Return the next turn, step, or leg of the exploration."""
        left, right = self.noses.means()
        has_bout = self.noses.take()
        is_on_plume = has_bout or max(left, right) > self.settings.threshold_ppm
        self.n_without = 0 if is_on_plume else self.n_without + 1
        if self.n_without >= self.settings.give_up_steps or self.is_away:
            return self.explore(observation)
        phi_rad = bearing_rad(left, right, self.settings.gain)
        if phi_rad != 0.0:
            self.side = 1 if phi_rad > 0.0 else -1
        if not is_on_plume:
            return self.step(observation, self.side * self.half_rad)
        turn = turn_rad(phi_rad, straight_rad=self.straight_rad, half_rad=self.half_rad)
        if turn == 0.0 or self.has_turned:
            # A second turn on the spot would be the same again where the gas does not change.
            return self.step(observation, 0.0)
        return self.turn(observation, turn)

    def step(self, observation: Observation, by_rad: float) -> Command:
        """Return a turn with a step ahead."""
        self.heading_rad, self.has_turned = self.heading_rad + by_rad, False
        x_m, y_m, _ = observation.position_world_m
        step_m = self.settings.step_m
        place_m = (x_m + step_m * elementary.cos(self.heading_rad), y_m + step_m * elementary.sin(self.heading_rad))
        command = self.fly_to(observation, place_m)
        self.look_along(observation, command)
        return command.model_copy(update={"yaw_rad": math.remainder(self.heading_rad, math.tau)})

    def turn(self, observation: Observation, by_rad: float) -> Command:
        """Return a turn on the spot, with a hold to smell in the new direction."""
        self.heading_rad, self.has_turned = math.remainder(self.heading_rad + by_rad, math.tau), True
        return Command(tick=observation.tick, kind="hold", hold_s=self.settings.turn_hold_s, yaw_rad=self.heading_rad)

    def explore(self, observation: Observation) -> Command:
        """Return a leg to a place not seen yet, looking along it."""
        command = super().explore(observation)
        self.look_along(observation, command)
        return command.model_copy(update={"yaw_rad": math.remainder(self.heading_rad, math.tau)})

    def look_along(self, observation: Observation, command: Command) -> None:
        """Turn the heading to where a leg really goes: at walls that is not where it was to go."""
        assert command.position_world_m is not None
        dx_m = command.position_world_m[0] - observation.position_world_m[0]
        dy_m = command.position_world_m[1] - observation.position_world_m[1]
        if norm2(dx_m, dy_m) > 0.01:
            self.heading_rad = elementary.atan2(dy_m, dx_m)


if __name__ == "__main__":
    run(TwoNosesAgent)
