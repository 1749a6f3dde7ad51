"""Surge-cast: upwind while there is gas; across the wind, one way and then farther the other, when it is lost.

After Lochmatter and Martinoli 2008. README.md beside this file has the rules and the exact arithmetic.
"""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.method_settings import load_settings
from gslcosim.search.random_stream import RandomStream
from gslcosim.search.reactive.cast_and_surge import BlankMemory, CastSequence, side_or_random, surge_end_m
from gslcosim.search.reactive.reactive_searcher import ReactiveSearcher, ReactiveSettings
from gslcosim.search.senses.stop_and_measure import Contact

WANDER_M = 0.5
LEAST_LEG_M = 0.1


class SurgeCast(Agent):
    """Remembers where gas was met last, the wind there, and how far a cast has come."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.draws = RandomStream(briefing.seed)
        self.searcher = ReactiveSearcher(briefing, ReactiveSettings.of(self.settings), self.draws)
        self.blanks = BlankMemory(
            first_s=self.settings.memory_s, least_s=self.settings.least_memory_s, most_s=self.settings.most_memory_s
        )
        self.upwind_rad = 0.0  # that of the surge
        self.is_surging = False
        self.cast: CastSequence | None = None
        self.n_returns_left = 0

    def observe(self, observation: Observation) -> None:
        """Watch for gas on the way too."""
        self.searcher.observe(observation)
        if self.searcher.watch.is_hit:
            self.blanks.note_hit(observation.time_s)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg: surge, cast or explore."""
        self.observe(observation)
        may_abort = self.settings.aborts_legs and not self.is_surging
        contact = self.searcher.ask(observation, aborts=may_abort)
        if isinstance(contact, Command):
            return contact
        if contact.upwind_rad is None or self.searcher.is_away:
            self.is_surging, self.cast = False, None
            return self.explore(observation)
        if contact.has_gas:
            self.is_surging, self.cast = True, None
            self.upwind_rad = contact.upwind_rad
        if self.is_surging and not self.is_lost(observation, contact):
            return self.surge(observation, contact)
        if self.is_surging:
            self.is_surging, self.n_returns_left = False, self.settings.n_returns
            self.cast = self.new_cast(observation.position_world_m, contact)
            answer = self.searcher.lose(observation, contact, self.upwind_rad)
            if answer is not None:
                return answer
        return self.cast_or_explore(observation, contact)

    def cast_or_explore(self, observation: Observation, contact: Contact) -> Command:
        """Return the next leg of the cast; after it go back to the last gas and cast there; then explore."""
        while self.cast is not None:
            command = self.searcher.follow(observation, self.cast.next_turn_m)
            if command is not None:
                return command
            self.cast = self.new_cast(contact.last_m, contact) if self.n_returns_left > 0 and contact.last_m else None
            self.n_returns_left -= 1
        return self.explore(observation)

    def is_lost(self, observation: Observation, contact: Contact) -> bool:
        """Return whether the plume counts as lost: no gas for a distance, or for longer than the last blank."""
        if contact.has_gas:
            return False
        if self.settings.lost_by == "last_blank":
            return self.blanks.is_lost(observation.time_s)
        return contact.remaining_m(observation.position_world_m, self.settings.lost_m) <= LEAST_LEG_M

    def surge(self, observation: Observation, contact: Contact) -> Command:
        """Return a leg upwind, in line with the gas of the last leg; without gas only as far as it takes to lose it."""
        here_m, step_m = observation.position_world_m, self.settings.step_m
        if self.settings.lost_by == "distance":
            step_m = min(step_m, contact.remaining_m(here_m, self.settings.lost_m))
        return self.searcher.fly_to(observation, surge_end_m(here_m, contact.gas_m, self.upwind_rad, step_m))

    def new_cast(self, here_m: tuple[float, ...], contact: Contact) -> CastSequence:
        """Return a cast from a place that begins on the side on which gas was met last, else on a random one."""
        return CastSequence(
            anchor_m=(here_m[0], here_m[1]),
            upwind_rad=self.upwind_rad,
            side=side_or_random(contact.last_m or here_m, here_m, self.upwind_rad, self.draws),
            width_m=self.settings.cast_m,
            growth=self.settings.growth,
            n_legs=self.settings.n_casts,
        )

    def explore(self, observation: Observation) -> Command:
        """Return a leg without gas: to a place not seen yet, or at random nearby."""
        if self.settings.explore == "unseen" or self.searcher.is_away:
            return self.searcher.explore(observation)
        x_m, y_m, _ = observation.position_world_m
        wander_m = (self.draws.uniform(-WANDER_M, WANDER_M), self.draws.uniform(-WANDER_M, WANDER_M))
        return self.searcher.cast_to(observation, (x_m + wander_m[0], y_m + wander_m[1]))


if __name__ == "__main__":
    run(SurgeCast)
