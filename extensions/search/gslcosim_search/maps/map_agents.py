"""Agents that search with a map of the plane: one that believes from stop to stop, one that maps gas on its way."""

from abc import abstractmethod
from collections import deque
from collections.abc import Sequence
from types import SimpleNamespace
from typing import ClassVar, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from gslcosim.agent_kit import Briefing, Command, Observation
from gslcosim_search.beliefs import normalised
from gslcosim_search.maps import gr_gsl, kernel_dm, pmfs, published_pmfs
from gslcosim_search.maps.gr_gsl import GrGsl, GrGslSettings
from gslcosim_search.maps.kernel_dm import KernelMap, KernelWidths, ReadingCollector, choose_next_cell
from gslcosim_search.maps.pmfs import Pmfs, PmfsSettings
from gslcosim_search.maps.published_pmfs import FilamentSettings, PublishedPmfs
from gslcosim_search.maps.wind_map import WindMap, WindWeights
from gslcosim_search.motion.coverage import lawnmower_path_m
from gslcosim_search.motion.declaration import Estimate, UnchangedRule, by_variance
from gslcosim_search.motion.grid_paths import path_field
from gslcosim_search.motion.map_navigation import MapNavigator, Stop, StopRecorder
from gslcosim_search.search_agent import SearchAgent, extract_settings
from gslcosim_search.senses.instruments import find_noses, find_vane


class MapAgent(SearchAgent):
    """An agent that flies round the obstacles of a granted map, and believes over its cells.

    Its settings: cell_m, max_cells, clearance_m, wall_margin_m.
    """

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        settings = self.settings
        self.flights = MapNavigator(
            briefing,
            self.draws,
            cell_m=settings.cell_m,
            max_cells=settings.max_cells,
            clearance_m=settings.clearance_m,
            margin_m=settings.wall_margin_m,
        )
        self.grid = self.flights.grid

    def continue_leg(self, observation: Observation) -> Command | None:
        """Return the command while a leg is under way."""
        return self.flights.pilot.continue_leg(observation)


class StopBelief(Protocol):
    """Belief of a search that goes from stop to stop."""

    @property
    def p(self) -> NDArray[np.float64]:
        """The belief over the cells."""
        ...

    def give_up(self, point_m: Sequence[float]) -> None:
        """Leave a goal out that cannot be reached."""
        ...


BeliefT = TypeVar("BeliefT", bound=StopBelief)


class StopMapAgent(MapAgent, Generic[BeliefT]):
    """Stops, measures, believes, and goes on to a goal; declares when the belief is narrow.

    Its settings: those of a `MapAgent`, gas_threshold_ppm, finding_s, wind_divergence, declare_variance_m2.
    """

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        settings = self.settings
        self.watch = StopRecorder(briefing, threshold_ppm=settings.gas_threshold_ppm, every_s=settings.finding_s)
        self.method = self.build_method(settings)
        self.winds = self.build_winds(settings)

    @abstractmethod
    def build_method(self, settings: SimpleNamespace) -> BeliefT:
        """Return the method's belief over the cells of `flights`, and compile what it needs."""

    def build_winds(self, settings: SimpleNamespace) -> WindMap:
        """Return the wind map over the cells of `flights`; the edges of the plan are walls."""
        weights = WindWeights(divergence=settings.wind_divergence)
        return WindMap(self.flights.free, self.flights.grid, weights=weights)

    @abstractmethod
    def learn_stop(self, stop: Stop) -> None:
        """Take in what was measured at a stop; a sensor that still shows what it met before tells nothing."""

    @abstractmethod
    def next_goal(self, observation: Observation) -> tuple[int, ...] | None:
        """Return the cell to go to next, or None where there is none."""

    def observe(self, observation: Observation) -> None:
        """Collect what is measured until the next decision."""
        super().observe(observation)
        self.watch.add(observation)

    def continue_leg(self, observation: Observation) -> Command | None:
        """Return the command while a leg, or the next one on the way to the goal, is under way."""
        return super().continue_leg(observation) or self.flights.continue_to_goal(observation)

    def learn(self, observation: Observation) -> None:
        """Learn from what was measured at the stop; a goal that was not reached is given up."""
        if self.flights.goal_m is not None and self.flights.was_missed(observation):
            self.method.give_up(self.flights.goal_m)
        self.learn_stop(self.watch.stop(observation))

    @property
    def p(self) -> NDArray[np.float64]:
        """The method's belief."""
        return self.method.p

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return the estimate of the source once the belief is narrow."""
        return by_variance(self.p, self.grid, limit_m2=self.settings.declare_variance_m2)

    def next_leg(self, observation: Observation) -> Command:
        """Choose the next goal and set out for it; where there is none, or no way to it, stay."""
        cell = self.next_goal(observation)
        if cell is None:
            return self.flights.stay(observation)
        self.flights.go_to(self.flights.grid.centre_m(cell))
        return self.flights.leg(observation) or self.flights.stay(observation)


class PmfsAgent(StopMapAgent[Pmfs]):
    """Stops, measures, maps hits and the wind, and goes on to where believed sources disagree most: PMFS."""

    def build_method(self, settings: SimpleNamespace) -> Pmfs:
        """Return an even belief over the free cells."""
        pmfs.warm_up()
        flights = self.flights
        return Pmfs(flights.free, flights.grid, extract_settings(PmfsSettings, settings), flyable=flights.flyable)

    def learn_stop(self, stop: Stop) -> None:
        """Take in what was measured at a stop, and score sources where that is due."""
        self.method.visit(stop.position_m)
        if stop.wind is not None:
            self.winds.add(stop.position_m, stop.wind_world_m_s())
        if stop.findings:
            self.method.update(stop.position_m, [finding.is_hit for finding in stop.findings], stop.wind_world_m_s())
        if self.method.is_update_due(has_findings=bool(stop.findings)):
            self.method.score(self.winds.wind_m_s())

    def next_goal(self, observation: Observation) -> tuple[int, ...] | None:
        """Return the cell where believed sources disagree most, or None where none is left."""
        return self.method.next_goal(observation.position_world_m, self.draws)


class PublishedPmfsAgent(PmfsAgent):
    """PMFS as published: sources by simulations of filaments every few stops, against the map of hits."""

    def build_method(self, settings: SimpleNamespace) -> Pmfs:
        """Return an even belief over the free cells."""
        published_pmfs.warm_up()
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


class GrGslAgent(StopMapAgent[GrGsl]):
    """Stops, measures, believes, and goes on to the place that tells most: GrGSL."""

    def build_method(self, settings: SimpleNamespace) -> GrGsl:
        """Return an even belief over the free cells."""
        gr_gsl.warm_up()
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


class KernelMapAgent(MapAgent):
    """Maps the gas on its way over the room, then goes to where there is much of it; declares a peak that stays.

    Its settings: those of a `MapAgent`, mox_lag_s, reading_s, sigma_m, confidence_scale, decay_per_s, max_readings,
    motion, lane_m, step_m, hold_s, curiosity, travel_per_m, gas_threshold_ppm, peak_confidence, declare_radius_m,
    declare_legs; with wind also stretch_s.

    Where `has_wind` is true, readings are stretched along the wind.

    Source:
        Lilienthal, Reggente and others, Kernel DM+V; agents/kernel_dmv/README.md has the rules.
    """

    has_wind: ClassVar[bool] = False

    def __init__(self, briefing: Briefing) -> None:
        kernel_dm.warm_up()
        super().__init__(briefing)
        settings = self.settings
        nose, vane = find_noses(briefing)[0], find_vane(briefing) if self.has_wind else None
        lag_s = settings.mox_lag_s if nose.unit == "ohm" else 0.0
        self.readings = ReadingCollector(nose, vane, every_s=settings.reading_s, lag_s=lag_s)
        widths = KernelWidths(
            sigma_m=settings.sigma_m,
            stretch_s=settings.stretch_s if self.has_wind else 0.0,
            confidence_scale=settings.confidence_scale,
            decay_per_s=settings.decay_per_s,
        )
        self.gas = KernelMap(self.flights.grid, widths, max_readings=settings.max_readings)
        self.maps = self.gas.maps()
        self.lanes_m: deque[Sequence[float]] | None = None if settings.motion == "sweep" else deque()
        self.most_gas = 0.0
        self.unchanged = UnchangedRule(radius_m=settings.declare_radius_m, n_legs=settings.declare_legs)

    def observe(self, observation: Observation) -> None:
        """Put a reading on the map, where one is due."""
        super().observe(observation)
        reading = self.readings.add(observation)
        if reading is not None:
            self.gas.add(reading.place_m, reading.value, time_s=reading.time_s, wind_m_s=reading.wind_m_s)
            self.most_gas = max(self.most_gas, reading.value)

    def learn(self, observation: Observation) -> None:
        """Map what was read so far."""
        self.maps = self.gas.maps()

    @property
    def p(self) -> NDArray[np.float64]:
        """The variance of the gas over the free cells, scaled to sum 1."""
        return normalised(self.maps.variance * self.flights.free)

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return the place where the gas varies most, if there was gas and it has been there for some legs."""
        maps = self.maps
        peak = maps.peak(least_confidence=self.settings.peak_confidence)
        if peak is None or not self.most_gas > self.settings.gas_threshold_ppm:
            return None
        place_m = self.flights.grid.centre_m(peak)
        stays = self.unchanged.add(place_m)
        return Estimate(position_m=place_m, confidence=float(maps.confidence[peak])) if stays else None

    def next_leg(self, observation: Observation) -> Command:
        """Fly on along the lanes, or to the place that is most worth it; after a refusal to the next one."""
        flights, here_m = self.flights, observation.position_world_m
        if self.lanes_m is None:
            self.lanes_m = deque(lawnmower_path_m(flights.pilot.room, self.settings.lane_m, here_m))
            flights.goal_m = None
        if not flights.is_under_way(observation) and self.lanes_m:
            flights.go_to(self.lanes_m.popleft())
        elif not self.lanes_m and not flights.is_under_way(observation):
            self.go_to_the_best(here_m)
        leg = flights.leg(observation, at_most_m=self.settings.step_m, hold_s=self.settings.hold_s)
        return leg or flights.stay(observation)

    def go_to_the_best(self, here_m: Sequence[float]) -> None:
        """Set the goal that is worth most."""
        field = path_field(self.flights.flyable, self.flights.grid, here_m)
        assert field is not None, "there is always a cell to fly in"
        cell = choose_next_cell(
            self.maps,
            self.flights.flyable,
            field.length_m,
            curiosity=self.settings.curiosity,
            travel_per_m=self.settings.travel_per_m,
        )
        self.flights.go_to(self.flights.grid.centre_m(cell or self.flights.grid.nearest_cell(here_m)))


class WindKernelMapAgent(KernelMapAgent):
    """A search by kernel maps whose readings count along the wind: Kernel DM+V/W."""

    has_wind = True
