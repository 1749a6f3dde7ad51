"""PMFS as published: sources by simulations of filaments in the estimated wind, against a map of hits.

After Ojeda, Monroy and Gonzalez-Jimenez. README.md beside this file has the rules, method.yaml the parameters.
"""

from types import SimpleNamespace

from gslcosim.agent_kit import Observation, run
from gslcosim_search.maps.map_agents import StopMapAgent
from gslcosim_search.maps.pmfs import PmfsSettings
from gslcosim_search.maps.published_pmfs import FilamentSettings, PublishedPmfs, warm_up
from gslcosim_search.maps.wind_map import WindMap, WindWeights
from gslcosim_search.motion.map_navigation import Stop


class PublishedPmfsAgent(StopMapAgent[PublishedPmfs]):
    """Stops, measures, maps hits, simulates sources every few stops, and goes to where simulations disagree most."""

    program = __file__

    def build_method(self, settings: SimpleNamespace) -> PublishedPmfs:
        """Return an even belief over the free cells."""
        warm_up()
        flights = self.flights
        return PublishedPmfs(
            flights.free,
            flights.grid,
            PmfsSettings.of_hit_map(settings),
            FilamentSettings.of(settings),
            self.draws,
            flyable=flights.flyable,
        )

    def build_winds(self, settings: SimpleNamespace) -> WindMap:
        """Return a wind map whose edges are as those of the simulations."""
        weights = WindWeights(divergence=settings.wind_divergence)
        return WindMap(self.flights.free, self.flights.grid, weights=weights, edges=settings.edges)

    def learn_stop(self, stop: Stop) -> None:
        """Take in what was measured at a stop, and every few stops simulate sources."""
        self.method.visit(stop.position_m)
        if stop.wind is not None:
            self.winds.add(stop.position_m, stop.wind_world_m_s())
        if stop.findings:
            self.method.update(stop.position_m, [finding.is_hit for finding in stop.findings], stop.wind_world_m_s())
        if self.method.is_update_due():
            self.method.score(self.winds.wind_m_s())

    def next_goal(self, observation: Observation) -> tuple[int, ...] | None:
        """Return the cell where the simulations of believed sources differ most, or None where none is left."""
        return self.method.next_goal(observation.position_world_m, self.draws)


if __name__ == "__main__":
    run(PublishedPmfsAgent)
