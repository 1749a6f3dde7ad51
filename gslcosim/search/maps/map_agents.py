"""Agents that search with a map of the plane: one that believes from stop to stop, one that maps gas on its way."""

from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import ClassVar, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from gslcosim.agent_kit import Agent, Briefing, Command, Observation
from gslcosim.search.beliefs import BeliefPublisher, normalised
from gslcosim.search.maps import kernel_dm
from gslcosim.search.maps.kernel_dm import GasMaps, KernelMap, KernelWidths, ReadingCollector, choose_next_cell
from gslcosim.search.maps.wind_map import WindMap, WindWeights
from gslcosim.search.method_settings import load_settings
from gslcosim.search.motion.commands import declaration
from gslcosim.search.motion.coverage import lawnmower_path_m
from gslcosim.search.motion.declaration import DeclarationGuard, Estimate, UnchangedRule, by_variance
from gslcosim.search.motion.grid_paths import path_field
from gslcosim.search.motion.map_navigation import MapNavigator, Stop, StopRecorder
from gslcosim.search.random_stream import RandomStream
from gslcosim.search.senses.instruments import find_noses, find_vane


class MapAgent(Agent):
    """An agent that flies round the obstacles of a granted map, publishes a belief over its cells, and declares.

    A method is a subclass that names its `program` (`__file__`, with its card beside it).

    Its settings: cell_m, max_cells, clearance_m, wall_margin_m.
    """

    program: ClassVar[str]

    def __init__(self, briefing: Briefing) -> None:
        """Read the settings and the map.

        Raises:
            MethodError: the agent lacks something that its card asks for, or a parameter is wrong.
        """
        settings = self.settings = load_settings(briefing, self.program)
        self.draws = RandomStream(briefing.seed)
        self.flights = MapNavigator(
            briefing,
            self.draws,
            cell_m=settings.cell_m,
            max_cells=settings.max_cells,
            clearance_m=settings.clearance_m,
            margin_m=settings.wall_margin_m,
        )
        self.publisher = BeliefPublisher()
        self.declared = DeclarationGuard()
        self.height_m = briefing.search_height_m

    def answer(
        self, observation: Observation, p: NDArray[np.float64], found: Estimate | None, next_leg: Callable[[], Command]
    ) -> Command:
        """Return the declaration of an estimate that is news, else the next leg; the belief goes with either."""
        belief = self.publisher.message(observation, p, self.flights.grid, height_m=self.height_m)
        passed = self.declared.passes(found)
        if passed is not None:
            return declaration(observation, (*passed.position_m, self.height_m), passed.confidence, belief=belief)
        return next_leg().model_copy(update={"belief": belief})


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
        settings, flights = self.settings, self.flights
        self.watch = StopRecorder(briefing, threshold_ppm=settings.gas_threshold_ppm, every_s=settings.finding_s)
        self.method = self.build_method(settings)
        weights = WindWeights(divergence=settings.wind_divergence)
        self.winds = WindMap(flights.free, flights.grid, weights=weights)

    @abstractmethod
    def build_method(self, settings: SimpleNamespace) -> BeliefT:
        """Return the method's belief over the cells of `flights`, and compile what it needs."""

    @abstractmethod
    def learn(self, stop: Stop) -> None:
        """Take in what was measured at a stop; a sensor that still shows what it met before tells nothing."""

    @abstractmethod
    def next_goal(self, observation: Observation) -> tuple[int, ...] | None:
        """Return the cell to go to next, or None where there is none."""

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
        p = self.method.p
        found = by_variance(p, flights.grid, limit_m2=self.settings.declare_variance_m2)
        return self.answer(observation, p, found, lambda: self.next_leg(observation))

    def next_leg(self, observation: Observation) -> Command:
        """Choose the next goal and set out for it; where there is none, or no way to it, stay."""
        cell = self.next_goal(observation)
        if cell is None:
            return self.flights.stay(observation)
        self.flights.go_to(self.flights.grid.centre_m(cell))
        return self.flights.leg(observation) or self.flights.stay(observation)


class KernelMapAgent(MapAgent):
    """Maps the gas on its way over the room, then goes to where there is much of it; declares a peak that stays.

    Its settings: those of a `MapAgent`, mox_lag_s, reading_s, sigma_m, confidence_scale, decay_per_s, max_readings,
    motion, lane_m, step_m, hold_s, curiosity, travel_per_m, gas_threshold_ppm, peak_confidence, declare_radius_m,
    declare_legs; with wind also stretch_s.

    A method that stretches readings along the wind says so by `has_wind`.
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
        self.lanes_m: deque[Sequence[float]] | None = None if settings.motion == "sweep" else deque()
        self.most_gas = 0.0
        self.unchanged = UnchangedRule(radius_m=settings.declare_radius_m, n_legs=settings.declare_legs)

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
        maps = self.gas.maps()
        p = normalised(maps.variance * self.flights.free)
        return self.answer(observation, p, self.estimate(maps), lambda: self.next_leg(observation, maps))

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
