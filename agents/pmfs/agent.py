"""PMFS: a map of hits that goes round obstacles, and sources by how well their plume explains it.

After Ojeda, Monroy and Gonzalez-Jimenez. README.md beside this file has the rules, method.yaml the parameters.
"""

from types import SimpleNamespace

from gslcosim.agent_kit import Observation, run
from gslcosim_search.maps.map_agents import StopMapAgent
from gslcosim_search.maps.pmfs import Pmfs, PmfsSettings, warm_up
from gslcosim_search.motion.map_navigation import Stop


class PmfsAgent(StopMapAgent[Pmfs]):
    """Stops, measures, maps hits, believes, and goes on to where believed sources disagree most."""

    program = __file__

    def build_method(self, settings: SimpleNamespace) -> Pmfs:
        """Return an even belief over the free cells."""
        warm_up()
        flights = self.flights
        return Pmfs(flights.free, flights.grid, PmfsSettings.of(settings), flyable=flights.flyable)

    def learn_stop(self, stop: Stop) -> None:
        """Take in what was measured at a stop; a sensor that still shows what it met before tells nothing."""
        self.method.visit(stop.position_m)
        if stop.wind is not None:
            self.winds.add(stop.position_m, stop.wind_world_m_s())
        if stop.findings:
            self.method.update(stop.position_m, [finding.is_hit for finding in stop.findings], stop.wind_world_m_s())
            self.method.score(self.winds.wind_m_s())

    def next_goal(self, observation: Observation) -> tuple[int, ...] | None:
        """Return the cell where believed sources disagree most, or None where none is left."""
        return self.method.next_goal(observation.position_world_m, self.draws)


if __name__ == "__main__":
    run(PmfsAgent)
