"""Kernel DM+V/W: maps mean and variance of the gas, with readings stretched along the wind.

After Reggente and Lilienthal. README.md beside this file has the rules, method.yaml the parameters.
"""

from collections import deque
from collections.abc import Sequence

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.beliefs import BeliefPublisher, normalised
from gslcosim.search.maps.kernel_dm import GasMaps, KernelMap, KernelWidths, ReadingCollector, choose_next_cell, warm_up
from gslcosim.search.method_settings import load_settings
from gslcosim.search.motion.commands import declaration
from gslcosim.search.motion.coverage import lawnmower_path_m
from gslcosim.search.motion.declaration import DeclarationGuard, Estimate, UnchangedRule
from gslcosim.search.motion.grid_paths import path_field
from gslcosim.search.motion.map_navigation import MapNavigator
from gslcosim.search.random_stream import RandomStream
from gslcosim.search.senses.instruments import find_noses, find_vane


class KernelDmvw(Agent):
    """Maps the gas on its way over the room, then goes to where there is much of it; declares a peak that stays."""

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
        nose = find_noses(briefing)[0]
        lag_s = settings.mox_lag_s if nose.unit == "ohm" else 0.0
        self.readings = ReadingCollector(nose, find_vane(briefing), every_s=settings.reading_s, lag_s=lag_s)
        widths = KernelWidths(
            sigma_m=settings.sigma_m,
            stretch_s=settings.stretch_s,
            confidence_scale=settings.confidence_scale,
            decay_per_s=settings.decay_per_s,
        )
        self.gas = KernelMap(self.flights.grid, widths, max_readings=settings.max_readings)
        self.lanes_m: deque[Sequence[float]] | None = None if settings.motion == "sweep" else deque()
        self.most_gas = 0.0
        self.unchanged = UnchangedRule(radius_m=settings.declare_radius_m, n_legs=settings.declare_legs)
        self.declared = DeclarationGuard()
        self.publisher = BeliefPublisher()
        self.height_m = briefing.search_height_m

    def observe(self, observation: Observation) -> None:
        """Put a reading on the map, where one is due."""
        reading = self.readings.add(observation)
        if reading is not None:
            self.gas.add(reading.place_m, reading.value, time_s=reading.time_s, wind_m_s=reading.wind_m_s)
            self.most_gas = max(self.most_gas, reading.value)

    def decide(self, observation: Observation) -> Command:
        """Declare a peak that has stayed where it is, else fly on."""
        self.observe(observation)
        if self.flights.pilot.is_busy(observation):
            return self.flights.pilot.stay(observation)
        maps, grid = self.gas.maps(), self.flights.grid
        belief = self.publisher.message(
            observation, normalised(maps.variance * self.flights.free), grid, height_m=self.height_m
        )
        found = self.declared.passes(self.estimate(maps))
        if found is not None:
            return declaration(observation, (*found.position_m, self.height_m), found.confidence, belief=belief)
        return self.next_leg(observation, maps).model_copy(update={"belief": belief})

    def estimate(self, maps: GasMaps) -> Estimate | None:
        """Return the place where the gas varies most, if there was gas and it has been there for some legs."""
        peak = maps.peak(least_confidence=self.settings.peak_confidence)
        if peak is None or not self.most_gas > self.settings.gas_threshold_ppm:
            return None
        place_m = self.flights.grid.centre_m(peak)
        stays = self.unchanged.add(place_m)
        return Estimate(position_m=place_m, confidence=float(maps.confidence[peak])) if stays else None

    def next_leg(self, observation: Observation, maps: GasMaps) -> Command:
        """Fly on along the lanes, or to the place that is most worth it; after a refusal to the next one."""
        flights, here_m = self.flights, observation.position_world_m
        if self.lanes_m is None:
            self.lanes_m = deque(lawnmower_path_m(flights.pilot.room, self.settings.lane_m, here_m))
            flights.goal_m = None
        if not flights.is_under_way(observation) and self.lanes_m:
            flights.go_to(self.lanes_m.popleft())
        elif not self.lanes_m and not flights.is_under_way(observation):
            self.go_to_the_best(here_m, maps)
        leg = flights.leg(observation, at_most_m=self.settings.step_m, hold_s=self.settings.hold_s)
        return leg or flights.stay(observation)

    def go_to_the_best(self, here_m: Sequence[float], maps: GasMaps) -> None:
        """Set the goal that is worth most."""
        field = path_field(self.flights.flyable, self.flights.grid, here_m)
        assert field is not None, "there is always a cell to fly in"
        cell = choose_next_cell(
            maps,
            self.flights.flyable,
            field.length_m,
            curiosity=self.settings.curiosity,
            travel_per_m=self.settings.travel_per_m,
        )
        self.flights.go_to(self.flights.grid.centre_m(cell or self.flights.grid.nearest_cell(here_m)))


if __name__ == "__main__":
    run(KernelDmvw)
