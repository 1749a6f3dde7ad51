"""Surge-cast in three dimensions: upwind while there is gas; to the sides, up and down when it is lost.

After Rahbar et al. 2017. README.md beside this file has the rules.
"""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.method_settings import load_settings
from gslcosim.search.random_stream import RandomStream
from gslcosim.search.reactive.cast_and_surge import PlaneCastSequence, side_or_random, surge_end_m
from gslcosim.search.reactive.reactive_searcher import ReactiveSearcher, ReactiveSettings
from gslcosim.search.senses.stop_and_measure import Contact

LEAST_LEG_M = 0.1
Vec3 = tuple[float, float, float]


class SurgeCast3d(Agent):
    """Remembers where gas was met last, the wind there, how far a cast has come, and at which height it explores."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.draws = RandomStream(briefing.seed)
        self.searcher = ReactiveSearcher(briefing, ReactiveSettings.of(self.settings), self.draws)
        self.height_m = briefing.search_height_m  # of the exploration
        self.n_layers = 0
        self.upwind_rad = 0.0
        self.is_surging = False
        self.cast: PlaneCastSequence | None = None
        self.n_returns_left = 0

    def observe(self, observation: Observation) -> None:
        """Watch for gas on the way too."""
        self.searcher.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg: surge, cast or explore."""
        contact = self.searcher.ask(observation, aborts=not self.is_surging)
        if isinstance(contact, Command):
            return contact
        if contact.upwind_rad is None or self.searcher.is_away:
            self.is_surging, self.cast = False, None
            return self.explore(observation)
        if contact.has_gas:
            self.is_surging, self.cast, self.upwind_rad = True, None, contact.upwind_rad
        left_m = contact.remaining_m(observation.position_world_m, self.settings.lost_m)
        if self.is_surging and left_m > LEAST_LEG_M:
            return self.surge(observation, contact, min(self.settings.step_m, left_m))
        if self.is_surging:
            self.is_surging, self.n_returns_left = False, self.settings.n_returns
            self.cast = self.new_cast(observation.position_world_m, contact)
            answer = self.searcher.lose(observation, contact, self.upwind_rad)
            if answer is not None:
                return answer
        return self.cast_or_explore(observation, contact)

    def surge(self, observation: Observation, contact: Contact, step_m: float) -> Command:
        """Return a level leg upwind, on the line and at the height of the gas of the last leg."""
        here_m = observation.position_world_m
        x_m, y_m = surge_end_m(here_m, contact.gas_m, self.upwind_rad, step_m)
        return self.searcher.fly_to(observation, (x_m, y_m, here_m[2] if contact.gas_m is None else contact.gas_m[2]))

    def cast_or_explore(self, observation: Observation, contact: Contact) -> Command:
        """Return the next leg of the cast; after it go back to the last gas and cast there; then explore."""
        while self.cast is not None:
            command = self.searcher.follow(observation, self.cast.next_turn_m)
            if command is not None:
                return command
            self.cast = self.new_cast(contact.last_m, contact) if self.n_returns_left > 0 and contact.last_m else None
            self.n_returns_left -= 1
        return self.explore(observation)

    def new_cast(self, here_m: Vec3, contact: Contact) -> PlaneCastSequence:
        """Return a cast from a place that begins on the side, and above or below, where gas was met last."""
        last_m = contact.last_m or here_m
        return PlaneCastSequence(
            anchor_m=here_m,
            upwind_rad=self.upwind_rad,
            side=side_or_random(last_m, here_m, self.upwind_rad, self.draws),
            lift=1 if last_m[2] >= here_m[2] else -1,
            width_m=self.settings.cast_m,
            height_m=self.settings.cast_height_m,
            n_legs=self.settings.n_casts,
        )

    def explore(self, observation: Observation) -> Command:
        """Return a leg without gas; when all of a height is seen the next one comes: above, below, farther above."""
        if self.searcher.unseen.n_unseen == 0:
            self.n_layers += 1
            away_m = (self.n_layers + 1) // 2 * self.settings.layer_m * (1 if self.n_layers % 2 else -1)
            low_m, high_m = self.searcher.pilot.room.min_m[2], self.searcher.pilot.room.max_m[2]
            self.height_m = max(low_m, min(high_m, self.searcher.pilot.height_m + away_m))
        return self.searcher.explore(observation, z_m=self.height_m)


if __name__ == "__main__":
    run(SurgeCast3d)
