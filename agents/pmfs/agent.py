"""PMFS: a map of hits that goes round obstacles, and sources by how well their plume explains it.

After Ojeda, Monroy and Gonzalez-Jimenez. README.md beside this file has the rules, method.yaml the parameters.
"""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.beliefs import BeliefPublisher
from gslcosim.search.maps.pmfs import Pmfs, PmfsSettings, warm_up
from gslcosim.search.maps.wind_map import WindMap, WindWeights
from gslcosim.search.method_settings import load_settings
from gslcosim.search.motion.commands import declaration
from gslcosim.search.motion.declaration import DeclarationGuard, by_variance
from gslcosim.search.motion.map_navigation import MapNavigator, Stop, StopRecorder
from gslcosim.search.random_stream import RandomStream


class PmfsAgent(Agent):
    """Stops, measures, maps hits, believes, and goes on to where believed sources disagree most."""

    def __init__(self, briefing: Briefing) -> None:
        settings = self.settings = load_settings(briefing, __file__)
        warm_up()
        self.draws = RandomStream(briefing.seed)
        self.flights = MapNavigator(
            briefing,
            self.draws,
            cell_m=settings.cell_m,
            max_cells=settings.max_cells,
            clearance_m=settings.clearance_m,
            margin_m=settings.wall_margin_m,
        )
        self.watch = StopRecorder(briefing, threshold_ppm=settings.gas_threshold_ppm, every_s=settings.finding_s)
        self.method = Pmfs(
            self.flights.free, self.flights.grid, PmfsSettings.of(settings), flyable=self.flights.flyable
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
        self.method.visit(stop.position_m)
        if stop.wind is not None:
            self.winds.add(stop.position_m, stop.wind_world_m_s())
        if stop.findings:
            self.method.update(stop.position_m, [finding.is_hit for finding in stop.findings], stop.wind_world_m_s())
            self.method.score(self.winds.wind_m_s())

    def next_leg(self, observation: Observation) -> Command:
        """Choose the next goal and set out for it; where there is none, or no way to it, stay."""
        cell = self.method.next_goal(observation.position_world_m, self.draws)
        if cell is None:
            return self.flights.stay(observation)
        self.flights.go_to(self.flights.grid.centre_m(cell))
        return self.flights.leg(observation) or self.flights.stay(observation)


if __name__ == "__main__":
    run(PmfsAgent)
