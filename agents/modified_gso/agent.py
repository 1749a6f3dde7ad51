"""Modified GSO: glowworms that find plumes, gather, declare the source, and leave its surroundings to find others.

After Zhang et al., as described in the thesis on GSL-Bench. README.md beside this file has the rules.
"""

import math

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search.swarms.glowworms import Glowworm, Vector, is_in_excluded_region
from gslcosim_search.swarms.particle_swarm import Sighting, rotate, scale_to_length


class ModifiedGso(Glowworm):
    """One glowworm; it knows the places that have been declared, by itself or by others."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.declared_m: list[tuple[float, float]] = []
        self.is_ignored = lambda place_m: is_in_excluded_region(place_m, self.declared_m, self.settings.forbidden_m)
        self.is_leaving = False
        self.n_told = 0
        self.zigzag_side = self.side

    def observe(self, observation: Observation) -> None:
        """Measure and listen: the others send what they have declared."""
        for _, report in self.listen(observation):
            if len(report.numbers) >= 3:
                self.forbid((report.numbers[1] / 100.0, report.numbers[2] / 100.0))

    def decide(self, observation: Observation) -> Command:
        """Return the next leg, or the declaration; what is declared is forbidden from then on."""
        command = super().decide(observation)
        if command.declaration is not None:
            x_m, y_m, _ = command.declaration.position_world_m
            self.forbid((x_m, y_m))
        return command

    def forbid(self, place_m: tuple[float, float]) -> None:
        """Remember a declared place, unless it is one that is known, and forget the gas that belongs to it."""
        if is_in_excluded_region(place_m, self.declared_m, self.settings.forbidden_m):
            return
        self.declared_m.append(place_m)
        self.glow.darken()
        if self.own_best is not None and self.is_ignored(self.own_best.place_m):
            self.own_best = None

    def step(self, best: Sighting | None) -> Vector:
        """Gather where there is gas, or find a plume; who is in a declared region flies elsewhere first."""
        self.glow_by_odour()
        self.numbers = (self.luciferin, *self.told_m())
        is_inside = self.is_ignored(tuple(map(float, self.place_m)))
        if is_inside and not self.is_leaving:
            self.spiral.move_on()
        self.is_leaving = (is_inside or self.is_leaving) and self.spiral.is_on_its_way(self.place_m)
        if self.is_leaving:
            return self.spiral.step(self.place_m)
        social_m = self.social_step()
        if social_m is not None:
            return social_m
        upwind_m = self.upwind_step()
        if best is None or self.luciferin <= 0.0 or upwind_m is None:
            return self.find()
        self.spiral.forget()
        return upwind_m

    def find(self) -> Vector:
        """Return the next step to find a plume: on a spiral, or at an angle to upwind that changes side at walls."""
        upwind_m = self.upwind_step()
        if self.settings.finding == "spiral" or upwind_m is None:
            return self.spiral.step(self.place_m)
        angle_rad = math.radians(self.settings.zigzag_deg)
        for side in (self.zigzag_side, -self.zigzag_side):
            step_m = scale_to_length(rotate(upwind_m, side * angle_rad), self.settings.leg_m)
            if self.pilot.room.contains(tuple(self.place_m + step_m)):
                self.zigzag_side = side
                return step_m
        return self.random_step()

    def told_m(self) -> tuple[float, ...]:
        """Return one of the declared places in centimetres, each in its turn: texts are short, and some are lost."""
        if not self.declared_m:
            return ()
        self.n_told += 1
        x_m, y_m = self.declared_m[self.n_told % len(self.declared_m)]
        return float(round(100.0 * x_m)), float(round(100.0 * y_m))


if __name__ == "__main__":
    run(ModifiedGso)
