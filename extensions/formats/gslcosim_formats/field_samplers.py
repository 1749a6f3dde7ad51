"""Gas and wind outside of a run: samples at any points, and the truth for scoring. Never for agents.

What agents import cannot reach this module (see .importlinter), and nothing of it is a message.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gslcosim.base.errors import UsageError
from gslcosim.base.quantities import Vec3
from gslcosim.base.ticks import NS_PER_S, seconds_from_ticks
from gslcosim.environment.grid_kernels import trilinear_wind_at_points
from gslcosim.environment.model import Cell, Environment, Grid
from gslcosim.scenario import Scenario
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_services.fields.gas_field import GasField, PointGrid, Visibility
from gslcosim_services.fields.gas_setup import gas_seed, gas_timing, list_gas_names, mean_release_m3_s
from gslcosim_services.fields.mixing_ratio import CUTOFF_SIGMA, Walls, check_points

# So many points at a time keep the working memory of readings small.
CHUNK_SIZE = 65536


@dataclass(frozen=True, kw_only=True)
class Instant:
    """Instant to sample: a time [s], or the number of a stored frame; exactly one of them is there."""

    time_s: float | None = None
    frame: int | None = None


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """Visibility of gas in samples; without a cut-off it is the model's own."""

    has_line_of_sight: bool = True
    cutoff_sigma: float | None = None


class FieldSampler(Protocol):
    """Gas and wind that can be sampled at instants."""

    def grid(self, instant: Instant) -> Grid:
        """Return the cells of the room."""
        ...

    def gas_ppm(self, points_world_m: NDArray[np.float64], instant: Instant, view: ViewOptions) -> NDArray[np.float64]:
        """Return the (m,) mixing ratio [ppm by volume] at (m, 3) points, world frame [m]."""
        ...

    def gas_ppm_on(self, grid: PointGrid, instant: Instant, view: ViewOptions) -> NDArray[np.float64]:
        """Return the (nx, ny, nz) mixing ratio [ppm by volume] on a grid."""
        ...

    def wind_m_s(self, points_world_m: NDArray[np.float64], instant: Instant) -> NDArray[np.float64]:
        """Return the (m, 3) wind [m/s] at (m, 3) points, world frame."""
        ...


def build_lattice(min_m: Vec3, max_m: Vec3, spacing_m: float) -> PointGrid:
    """Return the centres of all cubic cells that lie wholly in a box, of the lattice through the world's origin.

    So rooms of any wall thickness have the same points: (i + 0.5) * spacing_m along each axis.
    """
    low = np.ceil(np.asarray(min_m) / spacing_m - 1e-9).astype(np.int64)
    high = np.floor(np.asarray(max_m) / spacing_m + 1e-9).astype(np.int64)
    if (high <= low).any():
        sides_m = np.subtract(max_m, min_m)
        raise UsageError(f"--grid: expected a spacing below the sides of the room, {sides_m} m, was {spacing_m:g} m.")
    nx, ny, nz = (high - low).tolist()
    x, y, z = ((low + 0.5) * spacing_m).tolist()
    return PointGrid(first_m=(x, y, z), spacing_m=spacing_m, shape=(nx, ny, nz))


class ScenarioFieldSampler(FieldSampler):
    """Gas and wind of a scenario in its environment; see `FieldSampler`.

    A time counts from the start of the run, `gas.warm_up_s` after the sources opened; a frame is a tick of the run.
    Without a scenario there is no gas, and a frame is one of the wind's.
    """

    def __init__(self, environment: Environment, scenario: Scenario | None = None, *, gas: str | None = None) -> None:
        self._environment = environment
        # Any instant may be asked for, on tape are those that a run looks at.
        self._scenario = scenario and scenario.model_copy(
            update={"gas": scenario.gas.model_copy(update={"tape": False})}
        )
        self._gas = gas

    @override
    def grid(self, instant: Instant) -> Grid:
        del instant
        return self._environment.grid

    @override
    def gas_ppm(self, points_world_m: NDArray[np.float64], instant: Instant, view: ViewOptions) -> NDArray[np.float64]:
        field, i_gas = self._field(instant, view)
        return read_in_chunks(lambda some: field.mixing_ratio_ppm_at(some)[:, i_gas], check_points(points_world_m))

    @override
    def gas_ppm_on(self, grid: PointGrid, instant: Instant, view: ViewOptions) -> NDArray[np.float64]:
        field, i_gas = self._field(instant, view)
        if view.has_line_of_sight:
            points = grid.points_m()
            return read_in_chunks(lambda some: field.mixing_ratio_ppm_at(some)[:, i_gas], points).reshape(grid.shape)
        cutoff_sigma = CUTOFF_SIGMA if view.cutoff_sigma is None else view.cutoff_sigma
        return field.mixing_ratio_ppm_on_grid(grid, gas=i_gas, cutoff_sigma=cutoff_sigma)

    @override
    def wind_m_s(self, points_world_m: NDArray[np.float64], instant: Instant) -> NDArray[np.float64]:
        points, grid, wind = check_points(points_world_m), self._environment.grid, self._environment.wind
        if self._scenario is not None:
            own_m_s = self._field(instant, ViewOptions())[0].wind_m_s_at(points)
            if own_m_s is not None:
                return own_m_s
            number = wind.frame_at(self._scenario.gas.warm_up_s + self._time_s(instant))
        elif instant.time_s is not None:
            number = wind.frame_at(instant.time_s)
        else:
            number, n_frames = instant.frame or 0, len(wind.velocity_m_s)
            if number >= n_frames:
                raise UsageError(f"--frame: expected one of the wind's frames, 0 to {n_frames - 1}, was {number}.")
        return trilinear_wind_at_points(wind.velocity_m_s[number], grid.origin_m, grid.cell_m, points)

    def _time_s(self, instant: Instant) -> float:
        if instant.time_s is not None:
            return instant.time_s
        assert self._scenario is not None
        assert instant.frame is not None
        return seconds_from_ticks(instant.frame, self._scenario.tick_ns)

    def _field(self, instant: Instant, view: ViewOptions) -> tuple[GasField, int]:
        scenario = self._scenario
        if scenario is None:
            raise UsageError(
                f"{self._environment.name}: expected a run or a scenario to release gas, was an environment without. "
                "Add --scenario SCENARIO, name a run in its place, or ask for --quantity wind."
            )
        sight = Visibility(
            walls=Walls.of(self._environment) if view.has_line_of_sight else None,
            cutoff_sigma=view.cutoff_sigma or CUTOFF_SIGMA,
        )
        is_default = view.has_line_of_sight and view.cutoff_sigma is None
        field = build_gas_field(scenario, self._environment, sight=None if is_default else sight)
        timing = gas_timing(scenario)
        field.reset(gas_seed(scenario, scenario.seed))
        field.advance(timing.warm_up_steps + int(self._time_s(instant) / timing.step_s + 1e-9))
        return field, self._index_of_gas(field.gases)

    def _index_of_gas(self, gases: tuple[str, ...]) -> int:
        if self._gas is None:
            return 0
        if self._gas not in gases:
            raise UsageError(f"--gas: expected one of {', '.join(gases)}, was {self._gas!r}.")
        return gases.index(self._gas)


def read_in_chunks(
    reading: Callable[[NDArray[np.float64]], NDArray[np.float64]], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what a reading says of many points, some of them at a time."""
    parts = [reading(points[first : first + CHUNK_SIZE]) for first in range(0, len(points), CHUNK_SIZE)]
    return np.concatenate(parts) if parts else np.zeros(0)


@dataclass(frozen=True, kw_only=True)
class TrueSource:
    """A source: its place, world frame [m], its gas, and the pure gas it releases in the mean [m3/s].

    The rate is absent where it follows a schedule.
    """

    position_world_m: Vec3
    gas: str
    release_m3_s: float | None


@dataclass(frozen=True, kw_only=True)
class GroundTruth:
    """All gas of one instant.

    `time_s` counts from the start of the run; `mixing_ratio_ppm` is (n_gases, nx, ny, nz) at the points of `grid`, 0
    outside the air; `is_air` (nx, ny, nz) says which points are in it.
    """

    time_s: float
    sources: tuple[TrueSource, ...]
    gases: tuple[str, ...]
    grid: PointGrid
    mixing_ratio_ppm: NDArray[np.float64]
    is_air: NDArray[np.bool_]


def list_true_sources(scenario: Scenario) -> tuple[TrueSource, ...]:
    """Return the sources of a scenario, in its order."""
    return tuple(
        TrueSource(
            position_world_m=source.position_m,
            gas=source.gas or scenario.gas.gas,
            release_m3_s=None if source.release.kind == "scheduled" else mean_release_m3_s(source),
        )
        for source in scenario.gas.sources
    )


def compute_ground_truth(
    scenario: Scenario,
    environment: Environment,
    *,
    time_s: float,
    spacing_m: float = 0.25,
    seed: int | None = None,
) -> GroundTruth:
    """Return all gas of a scenario at a time, computed again; rotors that blow gas away are not in it.

    Args:
        scenario: Its gas and sources.
        environment: Its room.
        time_s: Time since the start of the run [s]; between gas steps the gas rests.
        spacing_m: Distance of points [m]; see `build_lattice`.
        seed: The run's seed; absent: the scenario's.
    """
    live = scenario.model_copy(update={"gas": scenario.gas.model_copy(update={"tape": False})})
    field, timing = build_gas_field(live, environment), gas_timing(live)
    field.reset(gas_seed(live, scenario.seed if seed is None else seed))
    step_ns = round(timing.step_s * NS_PER_S)
    field.advance(timing.warm_up_steps + round(time_s * NS_PER_S) // step_ns)
    return ground_truth_from_field(field, scenario, environment, time_s=time_s, spacing_m=spacing_m)


def ground_truth_from_field(
    field: GasField, scenario: Scenario, environment: Environment, *, time_s: float, spacing_m: float = 0.25
) -> GroundTruth:
    """Return all gas of a field as it is now; see `compute_ground_truth`.

    Filaments are summed up to 5 sigma and without looking for walls, so that gas beside a thin wall may reach through.
    """
    room = environment.grid
    grid = build_lattice(room.origin_m, room.max_m, spacing_m)
    cells = room.cell_of(grid.points_m())
    is_air = (environment.occupancy[tuple(cells.T)] != Cell.SOLID).reshape(grid.shape)
    ppm = [field.mixing_ratio_ppm_on_grid(grid, gas=i, cutoff_sigma=CUTOFF_SIGMA) for i in range(len(field.gases))]
    return GroundTruth(
        time_s=time_s,
        sources=list_true_sources(scenario),
        gases=list_gas_names(scenario.gas),
        grid=grid,
        mixing_ratio_ppm=np.stack(ppm) * is_air,
        is_air=is_air,
    )
