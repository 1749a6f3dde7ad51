"""PMFS as published: sources by simulations of filaments in the estimated wind, against a map of hits.

After Ojeda, Monroy and Gonzalez-Jimenez. README.md beside this file has the rules, method.yaml the parameters.
"""

from types import SimpleNamespace

from gslcosim.agent_kit import run
from gslcosim.agent_kit.settings import extract_settings
from gslcosim_search.maps.map_agents import HitMapAgent
from gslcosim_search.maps.pmfs import PmfsSettings
from gslcosim_search.maps.published_pmfs import FilamentSettings, PublishedPmfs, warm_up
from gslcosim_search.maps.wind_map import WindMap, WindWeights


class PublishedPmfsAgent(HitMapAgent):
    """Stops, measures, maps hits, simulates sources every few stops, and goes to where simulations disagree most."""

    program = __file__

    def build_method(self, settings: SimpleNamespace) -> PublishedPmfs:
        """Return an even belief over the free cells."""
        warm_up()
        flights = self.flights
        return PublishedPmfs(
            flights.free,
            flights.grid,
            extract_settings(PmfsSettings, settings),
            extract_settings(FilamentSettings, settings),
            self.draws,
            flyable=flights.flyable,
        )

    def build_winds(self, settings: SimpleNamespace) -> WindMap:
        """Return a wind map whose edges are as those of the simulations."""
        weights = WindWeights(divergence=settings.wind_divergence)
        return WindMap(self.flights.free, self.flights.grid, weights=weights, edges=settings.edges)


if __name__ == "__main__":
    run(PublishedPmfsAgent)
