"""PMFS: a map of hits that goes round obstacles, and sources by how well their plume explains it.

After Ojeda, Monroy and Gonzalez-Jimenez. README.md beside this file has the rules, method.yaml the parameters.
"""

from types import SimpleNamespace

from gslcosim.agent_kit import run
from gslcosim.agent_kit.settings import extract_settings
from gslcosim_search.maps.map_agents import HitMapAgent
from gslcosim_search.maps.pmfs import Pmfs, PmfsSettings, warm_up


class PmfsAgent(HitMapAgent):
    """Stops, measures, maps hits, believes, and goes on to where believed sources disagree most."""

    program = __file__

    def build_method(self, settings: SimpleNamespace) -> Pmfs:
        """Return an even belief over the free cells."""
        warm_up()
        flights = self.flights
        return Pmfs(flights.free, flights.grid, extract_settings(PmfsSettings, settings), flyable=flights.flyable)


if __name__ == "__main__":
    run(PmfsAgent)
