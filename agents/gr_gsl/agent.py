"""GrGSL: a belief over the free cells of a known map, from hits, misses and the wind of the moment.

After Ojeda, Monroy and Gonzalez-Jimenez. README.md beside this file has the rules, method.yaml the parameters.
"""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.beliefs import BeliefPublisher
from gslcosim.search.maps.gr_gsl import GrGsl, GrGslSettings, warm_up
from gslcosim.search.maps.wind_map import WindMap, WindWeights
from gslcosim.search.method_settings import load_settings
from gslcosim.search.motion.commands import declaration
from gslcosim.search.motion.declaration import DeclarationGuard, by_variance
from gslcosim.search.motion.map_navigation import MapNavigator, Stop, StopRecorder
from gslcosim.search.random_stream import RandomStream


class GrGslAgent(Agent):
    """Stops, measures, believes, and goes on to the place that tells most; declares when the belief is narrow."""

    def __init__(self, briefing: Briefing) -> None:
        settings = self.settings = load_settings(briefing, __file__)
        warm_up()
        self.flights = MapNavigator(
            briefing,
            RandomStream(briefing.seed),
            cell_m=settings.cell_m,
            max_cells=settings.max_cells,
            clearance_m=settings.clearance_m,
            margin_m=settings.wall_margin_m,
        )
        self.watch = StopRecorder(briefing, threshold_ppm=settings.gas_threshold_ppm, every_s=settings.finding_s)
        self.method = GrGsl(
            self.flights.free,
            self.flights.grid,
            GrGslSettings.of(settings),
            flyable=self.flights.flyable,
        )
        weights = WindWeights(divergence=settings.wind_divergence)
        self.winds = WindMap(self.flights.free, self.flights.grid, weights=weights)
        self.publisher = BeliefPublisher()
        self.declared = DeclarationGuard()
        self.height_m = briefing.search_height_m

    def observe(self, observation: Observation) -> None:
        """Collect what is measured until the next decision."""
        self.watch.add(observation)

    def decide(self, observation: Observation) -> Command:
        """Go on to the goal; there learn from what was measured, and declare or choose the next goal."""
        flights = self.flights
        if flights.pilot.is_busy(observation):
            return flights.pilot.stay(observation)
        if flights.is_under_way(observation) and (leg := flights.leg(observation)) is not None:
            return leg
        if flights.goal_m is not None and flights.was_missed(observation):
            self.method.give_up(flights.goal_m)
        self.learn(self.watch.stop(observation))
        p, grid = self.method.p, flights.grid
        belief = self.publisher.message(observation, p, grid, height_m=self.height_m)
        found = self.declared.passes(by_variance(p, grid, limit_m2=self.settings.declare_variance_m2))
        if found is not None:
            return declaration(observation, (*found.position_m, self.height_m), found.confidence, belief=belief)
        return self.next_leg(observation).model_copy(update={"belief": belief})

    def learn(self, stop: Stop) -> None:
        """Take in what was measured at a stop; a sensor that still shows what it met before tells nothing."""
        if stop.wind is not None:
            self.winds.add(stop.position_m, stop.wind_world_m_s())
        self.method.visit(stop.position_m)
        if stop.is_hit is not None:
            downwind_rad = stop.downwind_rad(self.settings.wind_threshold_m_s)
            self.method.update(stop.position_m, is_hit=stop.is_hit, downwind_rad=downwind_rad)

    def next_leg(self, observation: Observation) -> Command:
        """Choose the next goal and set out for it; where there is none, or no way to it, stay."""
        if self.settings.motion == "informed":
            cell = self.method.most_informative(self.winds.wind_m_s())
        else:
            cell = self.method.most_likely(observation.position_world_m)
        if cell is None:
            return self.flights.stay(observation)
        self.flights.go_to(self.flights.grid.centre_m(cell))
        return self.flights.leg(observation) or self.flights.stay(observation)


if __name__ == "__main__":
    run(GrGslAgent)
