"""Vision prior: what its camera sees tells where a leak is likely, and puffs traced back with the wind tell the rest.

README.md beside this file has the rules, method.yaml the parameters.
"""

import math

import numpy as np

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search import elementary
from gslcosim_search.bayes.belief_search import PuffTracingAgent
from gslcosim_search.beliefs import normalised_from_log
from gslcosim_search.elementary import norm3
from gslcosim_search.senses.instruments import find_cameras
from gslcosim_search.senses.vision import SeenObjects, Viewpoint, prior_from_objects, seen_objects

N_POSES = 100  # so many ticks a picture may be late


class VisionPrior(PuffTracingAgent):
    """Looks around, believes in what is blue, and searches as a source map does; its camera faces the way."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.camera = find_cameras(briefing)[0]
        self.floor_m = briefing.bounds.min_m[2]
        self.log_prior = np.zeros(self.grid.shape)
        self.seen = SeenObjects()
        self.poses: dict[int, Viewpoint] = {}
        self.last_picture_tick = -1
        self.n_looks = 0

    def observe(self, observation: Observation) -> None:
        """Look at new pictures, and update the map by what was found."""
        self.look(observation)
        super().observe(observation)

    def look(self, observation: Observation) -> None:
        """Make a prior of what a new picture shows, from where the vehicle was when it was taken."""
        self.poses[observation.tick] = Viewpoint(position_m=observation.position_world_m, yaw_rad=observation.yaw_rad)
        self.poses.pop(observation.tick - N_POSES, None)
        image = observation.reading(self.camera).image
        if image is None or image.taken_tick <= self.last_picture_tick:
            return
        self.last_picture_tick = image.taken_tick
        view = self.poses.get(image.taken_tick)
        is_at_rest = norm3(*observation.velocity_world_m_s) < self.settings.still_m_s
        if view is not None and is_at_rest:
            seen = seen_objects(image, view, floor_m=self.floor_m, farthest_m=self.settings.farthest_m)
            if self.seen.add(seen):
                odds = {self.settings.likely_colour: self.settings.likely_odds}
                prior = prior_from_objects(
                    self.grid,
                    self.seen.things,
                    odds,
                    spread_m=self.settings.object_m,
                    other_odds=self.settings.other_odds,
                )
                self.log_prior = elementary.log_each(prior)

    @property
    def p(self) -> np.ndarray:
        """The belief by what was found and what was seen."""
        return normalised_from_log(self.map.log_p + self.log_prior)

    def continue_leg(self, observation: Observation) -> Command | None:
        """Return the command while a leg is under way, and to look around first."""
        command = super().continue_leg(observation)
        return self.turn(observation) if command is None and self.n_looks < self.settings.looks else command

    def decide(self, observation: Observation) -> Command:
        """Return the next leg, along which the camera looks, or a declaration."""
        command = super().decide(observation)
        return command.model_copy(update={"faces_path": command.kind == "waypoint"})

    def turn(self, observation: Observation) -> Command:
        """Return the command to look into the next direction."""
        yaw_rad = math.remainder(2.0 * math.pi * self.n_looks / self.settings.looks, 2.0 * math.pi)
        self.n_looks += 1
        return Command(tick=observation.tick, kind="hold", hold_s=self.settings.look_s, yaw_rad=yaw_rad)


if __name__ == "__main__":
    run(VisionPrior)
