"""Spiral: a square spiral of stops that begins anew wherever the source seems nearer than before; it needs no wind.

After Ferri et al. 2009. README.md beside this file has the rules.
"""

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search.reactive.reactive_searcher import ReactiveAgent
from gslcosim_search.reactive.spirals import SpiralPath, SquareSpiral, random_side
from gslcosim_search.senses.instruments import find_noses
from gslcosim_search.senses.stop_and_measure import BestProximity, Contact, proximity_index


class Spiral(ReactiveAgent):
    """Remembers the best proximity index, the samples of this stop, and how far a spiral has come."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.nose = find_noses(briefing)[0]
        self.tick_s = briefing.tick_ns / 1e9
        self.best = BestProximity(n_misses=self.settings.n_misses)
        self.samples: list[float] = []
        self.last_tick = -1
        self.spiral: SpiralPath | None = None

    def observe(self, observation: Observation) -> None:
        """Watch for gas on the way, and collect the samples of a stop."""
        super().observe(observation)
        is_new, self.last_tick = observation.tick != self.last_tick, observation.tick
        if observation.status != "holding":
            self.samples.clear()
        elif is_new and self.nose.is_ready(observation):
            self.samples.append(min(self.nose.ppm(observation), self.settings.most_ppm))

    @property
    def may_abort(self) -> bool:
        """True if gas ends a leg that is under way."""
        return self.spiral is None

    def next_step(self, observation: Observation, contact: Contact) -> Command:
        """Return the next leg: wind out, begin again, or explore."""
        is_better = self.best.is_better(self.index())
        self.samples.clear()
        if self.is_away:
            self.spiral = None
        elif is_better:
            self.spiral = self.start_spiral(observation)
        elif self.spiral is None and contact.gas_m is not None:
            # Gas was met on the way: stop there first.
            self.spiral = self.start_spiral(observation)
            return self.fly_to(observation, contact.gas_m[:2])
        place_m = None if self.spiral is None else self.spiral.next_place_m()
        if place_m is not None:
            return self.fly_to(observation, place_m)
        if self.spiral is not None and self.spiral.is_blocked:
            self.spiral = self.start_spiral(observation)
            place_m = self.spiral.next_place_m()
        if place_m is None:
            self.spiral = None
            return self.explore(observation)
        return self.fly_to(observation, place_m)

    def index(self) -> float:
        """Return the proximity index of this stop."""
        return proximity_index(
            self.samples, self.tick_s, mean_weight=self.settings.mean_weight, peak_weight=self.settings.peak_weight
        )

    def start_spiral(self, observation: Observation) -> SpiralPath:
        """Return a spiral that begins here in a random direction, to a random side."""
        s = self.settings
        spiral = SquareSpiral(
            side_m=s.side_m,
            growth_m=s.growth_m,
            heading_rad=self.draws.angle_rad(),
            side=random_side(self.draws),
            n_sides=s.n_sides,
        )
        room = self.pilot.room
        return SpiralPath(spiral, observation.position_world_m, is_free=room.contains, n_skips=s.n_skips)


if __name__ == "__main__":
    run(Spiral)
