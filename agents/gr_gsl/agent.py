"""GrGSL: a belief over the free cells of a known map, from hits, misses and the wind of the moment.

After Ojeda, Monroy and Gonzalez-Jimenez. README.md beside this file has the rules, method.yaml the parameters.
"""

from types import SimpleNamespace

from gslcosim.agent_kit import Observation, run
from gslcosim.agent_kit.settings import extract_settings
from gslcosim_search.maps.gr_gsl import GrGsl, GrGslSettings, warm_up
from gslcosim_search.maps.map_agents import StopMapAgent
from gslcosim_search.motion.map_navigation import Stop


class GrGslAgent(StopMapAgent[GrGsl]):
    """Stops, measures, believes, and goes on to the place that tells most; declares when the belief is narrow."""

    program = __file__

    def build_method(self, settings: SimpleNamespace) -> GrGsl:
        """Return an even belief over the free cells."""
        warm_up()
        flights = self.flights
        return GrGsl(flights.free, flights.grid, extract_settings(GrGslSettings, settings), flyable=flights.flyable)

    def learn_stop(self, stop: Stop) -> None:
        """Take in what was measured at a stop; a sensor that still shows what it met before tells nothing."""
        if stop.wind is not None:
            self.winds.add(stop.position_m, stop.wind_world_m_s())
        self.method.visit(stop.position_m)
        if stop.is_hit is not None:
            downwind_rad = stop.downwind_rad(self.settings.wind_threshold_m_s)
            self.method.update(stop.position_m, is_hit=stop.is_hit, downwind_rad=downwind_rad)

    def next_goal(self, observation: Observation) -> tuple[int, ...] | None:
        """Return the cell whose measurement tells most, or the likeliest one, by the setting `motion`.

        Before the first gas it is the least explored one.
        """
        if self.method.last_hit_m is None:
            return self.method.least_explored(observation.position_world_m)
        if self.settings.motion == "informed":
            return self.method.most_informative(self.winds.wind_m_s())
        return self.method.most_likely(observation.position_world_m)


if __name__ == "__main__":
    run(GrGslAgent)
