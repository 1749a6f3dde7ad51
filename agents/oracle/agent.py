"""The oracle: it is told where the source is, flies there and declares it. README.md beside this file has the rules."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, Waypoint, run
from gslcosim.agent_kit.commands import declaration
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.elementary import distance
from gslcosim_search.motion.map_navigation import KnownPaths

# How far from the room's bounds a way ends, tried in this order [m]; at last it stays at the height of the search.
MARGINS_M = (0.0, 0.4, None)
NEAR_M = 0.5


class Oracle(Agent):
    """Remembers the sources that it has not been to, which one it flies to, and how often that was refused."""

    def __init__(self, briefing: Briefing) -> None:
        settings = load_settings(briefing, __file__)
        self.paths = KnownPaths(briefing, clearance_m=settings.clearance_m)
        self.declares = settings.declares
        self.sources_m = list(briefing.known_sources)
        self.goal_m: tuple[float, float, float] | None = None
        self.n_refused = 0

    def decide(self, observation: Observation) -> Command:
        """Return the way to the nearest source that is left, its declaration on arrival, or at last a hold."""
        here_m = observation.position_world_m
        if self.goal_m is not None and self.has_arrived(observation, self.goal_m):
            return self.arrive(observation, self.goal_m)
        if self.goal_m is None:
            if not self.sources_m:
                return Command(tick=observation.tick, kind="hold")
            self.goal_m, self.n_refused = min(self.sources_m, key=lambda source_m: distance(source_m, here_m)), 0
        bends_m = self.paths.to_m(here_m, self.goal_m, margin_m=MARGINS_M[self.n_refused])
        places = tuple(Waypoint(position_world_m=bend_m) for bend_m in bends_m)
        return Command(tick=observation.tick, kind="mission", waypoints=places)

    def has_arrived(self, observation: Observation, goal_m: tuple[float, float, float]) -> bool:
        """Return whether the vehicle is where it wanted to go, or gets no nearer; counts what was refused."""
        if observation.notice is None or distance(goal_m, observation.position_world_m) < NEAR_M:
            return True
        self.n_refused += 1
        return self.n_refused == len(MARGINS_M)

    def arrive(self, observation: Observation, source_m: tuple[float, float, float]) -> Command:
        """Return the declaration of a source, or the way to the next one where nothing is to be declared."""
        self.sources_m.remove(source_m)
        self.goal_m = None
        return declaration(observation, source_m, 1.0) if self.declares else self.decide(observation)


if __name__ == "__main__":
    run(Oracle)
