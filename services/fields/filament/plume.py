"""Filament plume: growing Gaussian puffs that wind, buoyancy and eddies carry through an environment."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import ModelError, ScenarioError
from gslcosim.base.gases import air_density_mol_m3
from gslcosim.base.quantities import GRAVITY_M_S2, Vec3
from gslcosim.base.rng import stream
from gslcosim.environment.model import AT_START, Cell, Closed, Environment
from gslcosim_services.fields.filament.counter_rng import draw_uniforms
from gslcosim_services.fields.filament.downwash import Jets, blow_filaments_inplace
from gslcosim_services.fields.filament.filament_step import NOT_FINITE, move_filaments_inplace, trace_reflections
from gslcosim_services.fields.filament.release import POINT, ReleasePlan, SourceChange, SourceShape, SourceValve
from gslcosim_services.fields.filament.turbulent_step import N_HELD, move_turbulent_filaments_inplace
from gslcosim_services.fields.turbulence.air import TurbulentAir
from gslcosim_services.fields.turbulence.eddies import LargeEddies
from gslcosim_services.fields.turbulence.wall_faces import find_wall_faces

SPHERE_DRAG = 0.5
RADIUS_SIGMA = 2.0

_GADEN_3_GRAVITY_M_S2 = 9.8
_GADEN_3_AIR_KG_M3 = 1.205
_GADEN_3_VISCOSITY_PA_S = 19e-6

WindAt = Callable[[float], NDArray[np.float32]]
FIRST_CAPACITY = 1024
# Filament ids leave this many numbers to each source, so that one source never changes the draws of another.
IDS_PER_SOURCE = 2**40


@dataclass(frozen=True, kw_only=True)
class Buoyancy:
    """Vertical velocity of a filament relative to the air, upward: w = coefficient / sigma^power [m/s].

    `coefficient` [m^(1 + power) / s] is negative for heavy gases; sigma is the filament's standard deviation [m].
    """

    coefficient: float = 0.0
    power: int = 1

    def velocity_m_s(self, sigma_m: float) -> float:
        """Return the vertical velocity of a filament of this size [m/s], upward."""
        return self.coefficient / elementary.pow(sigma_m, float(self.power))


NEUTRAL = Buoyancy()


def terminal_velocity_buoyancy(specific_gravity: float, gas_volume_m3: float) -> Buoyancy:
    """Return the buoyancy of a filament at which the drag of a sphere around it balances its weight in air.

    g |1 - SG| rho V = Cd rho/2 pi r^2 w^2    =>    w = sqrt(2 g |1 - SG| V / (pi Cd)) / r      r = 2 sigma
    [m/s] = sqrt([m/s2] [m3]) / [m]; upward for SG < 1.

    V is the volume that the filament's gas takes when pure; it stays while the filament grows, so w falls as
    1 / sigma. A filament of 10 ppm and 0.1 m sinks at 1.4 mm/s with ethanol and rises at 4.7 mm/s with methane.

    Args:
        specific_gravity: Density of the pure gas relative to air SG, >= 0.
        gas_volume_m3: Volume of the pure gas in a filament V [m3].

    Source:
        Our derivation: balance of forces on a sphere that holds three quarters of the gas, with Cd = 0.5 (spheres at
        Reynolds numbers of some hundred to 1e5).
    Left out:
        Inertia (the balance is reached at once) and entrainment. Each filament moves by its own weight: a dense
        cloud of many filaments would move faster together.
    Held by:
        tests/unit/services/fields/filament/test_buoyancy.py
    """
    magnitude = math.sqrt(2.0 * GRAVITY_M_S2 * abs(1.0 - specific_gravity) * gas_volume_m3 / (math.pi * SPHERE_DRAG))
    return Buoyancy(coefficient=math.copysign(magnitude / RADIUS_SIGMA, 1.0 - specific_gravity), power=1)


def gaden_3_buoyancy(specific_gravity: float, ppm: float, sigma_m: float) -> Buoyancy:
    """Return GADEN 3's buoyancy, for repeating published work.

    w = g (1 - SG) rho X / (18 mu), X the mixing ratio at the filament's centre, ppm (sigma0 / sigma)^3 1e-6

    Its dimension is 1 / (m s): the square of a length is missing. The figures are taken as metres per second.

    Args:
        specific_gravity: Density of the pure gas relative to air SG.
        ppm: Mixing ratio at the centre at birth.
        sigma_m: Size at birth [m].

    Source:
        gaden_core, src/RunningSimulation.cpp, with g 9.8, rho 1.205 and mu 19e-6.
    Held by:
        tests/unit/services/fields/filament/test_buoyancy.py (ethanol -0.0131, methane 0.1541, hydrogen 0.3213 m/s at
        10 ppm)
    """
    at_birth = _GADEN_3_GRAVITY_M_S2 * (1.0 - specific_gravity) * _GADEN_3_AIR_KG_M3 * ppm * 1e-6
    return Buoyancy(coefficient=at_birth / (18.0 * _GADEN_3_VISCOSITY_PA_S) * (sigma_m * sigma_m * sigma_m), power=3)


class FilamentTable:
    """Table of filaments: positions, sizes, births, sources, and velocities in turbulent air; n rows are in use."""

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.position_m = np.zeros((capacity, 3))
        self.sigma_m = np.zeros(capacity)
        self.birth_steps = np.zeros(capacity)
        self.filament_id = np.zeros(capacity, np.int64)
        self.source_index = np.zeros(capacity, np.int32)
        self.own_velocity = np.zeros((capacity, 3))
        self.held = np.zeros((capacity, N_HELD), np.float32)

    def keep(self, is_kept: NDArray[np.bool_]) -> int:
        """Keep some of the first n filaments, (n,), in their order, as the first rows; return their number."""
        kept = np.flatnonzero(is_kept)
        n = len(kept)
        for column in self._columns:
            column[:n] = column[kept]
        return n

    def grown(self, capacity: int, n: int) -> "FilamentTable":
        """Return a table with more room, and the same first n filaments."""
        table = FilamentTable(capacity)
        for column, old in zip(table._columns, self._columns, strict=True):
            column[:n] = old[:n]
        return table

    @property
    def _columns(self) -> tuple[NDArray[Any], ...]:
        born = (self.birth_steps, self.filament_id, self.source_index)
        return self.position_m, self.sigma_m, *born, self.own_velocity, self.held


@dataclass(frozen=True, kw_only=True)
class ObstacleCells:
    """Obstacle cells: `occupancy` (nx, ny, nz) uint8 of `Cell`, `is_open`, see `find_open_cells`, and `wall_faces`."""

    occupancy: NDArray[np.uint8]
    is_open: NDArray[np.uint8]
    wall_faces: NDArray[np.uint8]

    @classmethod
    def by_doors(cls, environment: Environment, *, has_walls: bool) -> dict[Closed, Self]:
        """Return the cells at the start and with other doors closed; see `Environment.by_doors`.

        Args:
            has_walls: Whether walls stop the wind that turbulent air has between cells; none do in air that goes on
                beyond the grid.
        """
        found: dict[Closed, Self] = {}
        for closed, room in environment.by_doors().items():
            occupancy = np.ascontiguousarray(room.occupancy, np.uint8)
            walls = find_wall_faces(room) if has_walls else np.zeros(occupancy.shape, np.uint8)
            found[closed] = cls(occupancy=occupancy, is_open=find_open_cells(occupancy), wall_faces=walls)
        return found


def find_open_cells(occupancy: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return 1 where a cell and its 26 neighbours are free (the border of the grid counts as a wall), else 0."""
    is_free = np.pad(occupancy == Cell.FREE, 1, constant_values=False)
    for axis in range(3):
        ahead, behind = np.roll(is_free, 1, axis), np.roll(is_free, -1, axis)
        is_free = is_free & ahead & behind
    return np.ascontiguousarray(is_free[1:-1, 1:-1, 1:-1]).astype(np.uint8)


@dataclass(frozen=True, kw_only=True)
class GasSource:
    """A source of gas around a point in the air.

    `sigma_m` and `amount_mol` are a filament's size at birth and the gas it carries, `gas_index` is the index of the
    gas.
    """

    position_world_m: Vec3
    release: ReleasePlan
    sigma_m: float
    amount_mol: float
    gas_index: int = 0
    shape: SourceShape = POINT
    buoyancy: Buoyancy = NEUTRAL


@dataclass(frozen=True, kw_only=True)
class Filaments:
    """Filaments at one instant, from which the concentration is summed.

    `position_world_m` (n, 3) centres [m], `sigma_m` (n,) standard deviations [m], `source_index` (n,) int32 into the
    tables `amount_mol` (n_sources,) [mol per filament] and `gas_index` (n_sources,) int32. With `is_rounded`,
    positions and sizes are in single precision.
    """

    position_world_m: NDArray[np.floating]
    sigma_m: NDArray[np.floating]
    source_index: NDArray[np.int32]
    amount_mol: NDArray[np.float64]
    gas_index: NDArray[np.int32]
    is_rounded: bool = False

    @property
    def n_gases(self) -> int:
        """Number of gases, at least one."""
        return max(self.gas_index.tolist(), default=0) + 1


def filament_amount_mol(ppm: float, sigma_m: float) -> float:
    """Return the moles of gas in a filament with a given mixing ratio at its centre.

    N = ppm 1e-6 n_air (2 pi)^(3/2) sigma^3        n_air at 298 K and 1 atm
    [mol] = [1] [mol/m3] [m3]

    Args:
        ppm: Mixing ratio at the centre, parts per million by volume.
        sigma_m: Standard deviation [m].

    Source:
        GADEN, gaden_filament_simulator, with the full pi instead of 3.14159.
    Held by:
        tests/unit/services/fields/filament/test_plume.py (6.440745139e-06 mol for 10 ppm and 0.1 m)
    """
    return ppm * 1e-6 * air_density_mol_m3() * 2.0 * math.pi * math.sqrt(2.0 * math.pi) * (sigma_m * sigma_m * sigma_m)


# Random numbers of a run: the keys of the movements and of the places of birth, and the births of each source.
class _RandomStreams:
    def __init__(self, sources: tuple[GasSource, ...], seed: int) -> None:
        self.key = stream(seed, "fields.disperse").integers(2**64, dtype=np.uint64)
        self.place_key = stream(seed, "fields.place").integers(2**64, dtype=np.uint64)
        self.births = [source.release.start(stream(seed, f"fields.release.{i}")) for i, source in enumerate(sources)]


class FilamentPlume:
    """All filaments of a run; advances them step by step, births and outflow included.

    State: filaments in order of birth (source by source within a step) and the number of the step. Equal seeds give
    equal plumes, whatever the order or number of the sources: every draw is keyed by (seed, step, filament).
    """

    def __init__(
        self,
        environment: Environment,
        sources: tuple[GasSource, ...],
        *,
        step_s: float,
        growth_m2_s: float,
        diffusivity_m2_s: float,
        seed: int,
        noise_std_m: float | None = None,
        wind_at: WindAt | None = None,
        air: TurbulentAir | None = None,
    ) -> None:
        """Build a plume without filaments at time 0.

        Args:
            environment: Occupancy and wind; its arrays are not copied.
            sources: Sources of gas, all with buoyancy of one power.
            step_s: Length of a step [s].
            growth_m2_s: Growth of sigma^2 [m2/s].
            diffusivity_m2_s: Eddy diffusivity D per axis [m2/s].
            noise_std_m: Random displacement of a step per axis [m] in place of sqrt(2 D step_s), for compatibility.
            wind_at: The wind at a time [s] in place of the environment's, (nx, ny, n, 3) float32, n = nz or 1.
            air: Turbulence that moves filaments and makes them grow, in place of diffusivity, noise and growth.
        """
        _check_sources(environment, sources)
        if wind_at is None:
            _check_wind(environment)
        self._wind_at = self._wind_of_room if wind_at is None else wind_at
        self._environment = environment
        self._sources = sources
        self._step_s = step_s
        self._growth_m2_s = growth_m2_s
        self._noise_std_m = math.sqrt(2.0 * diffusivity_m2_s * step_s) if noise_std_m is None else noise_std_m
        has_walls = air is not None and not air.drifts_with_wind
        self._cells = ObstacleCells.by_doors(environment, has_walls=has_walls)
        self._room = self._cells[AT_START]
        self._wind_m_s = np.asarray(environment.wind.velocity_m_s)
        self._amount_mol = np.array([source.amount_mol for source in sources])
        self._gas_index = np.array([source.gas_index for source in sources], np.int32)
        self._place_m = _positions_m(sources)
        self._valves = [SourceValve() for _ in sources]
        self._sigma0_m = np.array([source.sigma_m for source in sources])
        self._buoyancy = np.array([source.buoyancy.coefficient for source in sources])
        self._buoyancy_power = _common_power(sources)
        self._table = FilamentTable(FIRST_CAPACITY)
        self._draws = _RandomStreams(sources, seed)
        self._air = air
        self._eddies = None if air is None else LargeEddies(air.scales, seed=seed)
        self._n_born = [0] * len(sources)
        self._n = 0
        self._step = 0

    def reset(self, seed: int) -> None:
        """Return to a room without gas at time 0, and to the initial state of the sources."""
        self._draws = _RandomStreams(self._sources, seed)
        if self._eddies is not None:
            self._eddies.reset(seed)
        self._room = self._cells[AT_START]
        self._place_m = _positions_m(self._sources)
        self._valves = [SourceValve() for _ in self._sources]
        self._n_born = [0] * len(self._sources)
        self._n = 0
        self._step = 0

    @property
    def n(self) -> int:
        """Number of filaments in the room."""
        return self._n

    @property
    def n_born(self) -> int:
        """Number of filaments born since the start."""
        return sum(self._n_born)

    @property
    def step(self) -> int:
        """Number of steps made."""
        return self._step

    @property
    def time_s(self) -> float:
        """Time since the first birth could happen [s]."""
        return self._step * self._step_s

    @property
    def filaments(self) -> Filaments:
        """The filaments now; views that the next step overwrites."""
        return Filaments(
            position_world_m=self._table.position_m[: self._n],
            sigma_m=self._table.sigma_m[: self._n],
            source_index=self._table.source_index[: self._n],
            amount_mol=self._amount_mol,
            gas_index=self._gas_index,
        )

    def add_filaments(self, position_world_m: NDArray[np.float64]) -> None:
        """Add filaments of the first source at (n, 3) places, world frame [m]: tracers, or gas that is there already.

        They are born now, and filaments like all others until the next reset.
        """
        n_new = len(position_world_m)
        self._make_room_for(n_new)
        self._table.position_m[self._n : self._n + n_new] = position_world_m
        self._register(0, [self.time_s] * n_new)

    def change_source(self, i_source: int, change: SourceChange) -> None:
        """Change a source from the next step on, until the next reset."""
        self._valves[i_source].change(change, self.time_s)
        if change.position_world_m is not None:
            self._place_m[i_source] = change.position_world_m

    def close_doors(self, closed: Closed) -> None:
        """Let these doors of the room be closed and all others open; filaments in a closed one are gone."""
        self._room = self._cells.get(closed, self._cells[AT_START])
        cells = self._environment.grid.cell_of(self._table.position_m[: self._n])
        self._n = self._table.keep(self._room.occupancy[tuple(cells.T)] != Cell.SOLID)

    def advance(self, n_steps: int = 1) -> None:
        """Advance by steps: wind of the step's start, births spread over the step."""
        for _ in range(n_steps):
            self._advance_one()

    def blow(self, jets: Jets) -> None:
        """Carry filaments down in the jets of vehicles for one step."""
        grid = self._environment.grid
        blow_filaments_inplace(
            self._table.position_m,
            self._n,
            jets.centre_world_m,
            jets.motor_distance_m,
            jets.outflow_m_s,
            self._room.occupancy,
            grid.origin_m,
            grid.cell_m,
            self._step_s,
        )

    def _advance_one(self) -> None:
        start_s = self._step * self._step_s
        self._step += 1
        for i in range(len(self._sources)):
            self._release(i, start_s)
        wind_m_s = self._wind_at(start_s)
        if self._air is None or self._eddies is None:
            n_left = self._move(wind_m_s)
        else:
            n_left = self._move_in_turbulence(wind_m_s, self._air, self._eddies)
        if n_left == NOT_FINITE:
            raise ModelError(f"fields: a filament's movement is not finite in gas step {self._step}.")
        self._n = n_left

    def _move(self, wind_m_s: NDArray[np.float32]) -> int:
        grid, room, table = self._environment.grid, self._room, self._table
        return move_filaments_inplace(
            table.position_m, table.sigma_m, table.birth_steps, table.filament_id, table.source_index, self._n,
            self._sigma0_m, self._buoyancy, self._buoyancy_power, wind_m_s,
            room.occupancy, room.is_open, grid.origin_m, grid.cell_m, self._step, self._step_s, self._noise_std_m,
            self._growth_m2_s, self._draws.key,
        )  # fmt: skip

    def _move_in_turbulence(self, wind_m_s: NDArray[np.float32], air: TurbulentAir, eddies: LargeEddies) -> int:
        grid, table, n_hold = self._environment.grid, self._table, air.steps_to_hold(self._step_s)
        layers = tuple(eddies.at((self._step - 1 + later) * self._step_s) for later in (0, n_hold))
        return move_turbulent_filaments_inplace(
            table.position_m, table.sigma_m, table.birth_steps, table.filament_id, table.source_index,
            table.own_velocity, table.held, self._n, self._buoyancy, self._buoyancy_power, wind_m_s,
            air.nodes_in(wind_m_s), layers, self._room.occupancy, self._room.wall_faces, grid.origin_m, grid.cell_m,
            self._step, self._step_s, n_hold, self._draws.key,
        )  # fmt: skip

    def _wind_of_room(self, time_s: float) -> NDArray[np.float32]:
        return self._wind_m_s[self._environment.wind.frame_at(time_s)]

    def _release(self, i_source: int, start_s: float) -> None:
        source = self._sources[i_source]
        births_s = self._valves[i_source].births_s(self._draws.births[i_source], start_s, self._step * self._step_s)
        n_new = len(births_s)
        if n_new == 0:
            return
        self._make_room_for(n_new)
        first_id = i_source * IDS_PER_SOURCE + self._n_born[i_source]
        new = slice(self._n, self._n + n_new)
        self._table.position_m[new] = self._place_m[i_source]
        if source.shape.kind != "point":
            self._table.position_m[new] = self._positions_in_shape(i_source, first_id, n_new)
        self._register(i_source, births_s)

    def _make_room_for(self, n_new: int) -> None:
        if self._n + n_new > self._table.capacity:
            self._table = self._table.grown(max(self._n + n_new, 2 * self._table.capacity), self._n)

    # All columns of the newborn filaments but their places, which are in the table already.
    def _register(self, i_source: int, births_s: list[float]) -> None:
        n_new, table = len(births_s), self._table
        new = slice(self._n, self._n + n_new)
        first_id = i_source * IDS_PER_SOURCE + self._n_born[i_source]
        table.sigma_m[new] = self._sources[i_source].sigma_m
        # The quotient may round to just after the step's end; an age below zero has no square root.
        table.birth_steps[new] = [min(birth_s / self._step_s, self._step) for birth_s in births_s]
        table.filament_id[new] = range(first_id, first_id + n_new)
        table.source_index[new] = i_source
        table.own_velocity[new] = 0.0
        table.held[new] = 0.0
        self._n_born[i_source] += n_new
        self._n += n_new

    # A place behind a wall is moved to the wall: the way from the source's position leads through air.
    def _positions_in_shape(self, i_source: int, first_id: int, n: int) -> NDArray[np.float64]:
        places_m = np.tile(self._place_m[i_source], (n, 1))
        offsets_m = self._sources[i_source].shape.offsets_m(
            draw_uniforms(self._draws.place_key, 3 * first_id, 3 * n).reshape(n, 3)
        )
        grid = self._environment.grid
        for i, (place_m, offset_m) in enumerate(zip(places_m.tolist(), offsets_m.tolist(), strict=True)):
            x, y, z, has_left, *_ = trace_reflections(
                self._room.occupancy, grid.origin_m, grid.cell_m, *place_m, *offset_m, reflects=False
            )
            if not has_left:
                places_m[i] = x, y, z
        return places_m


def _positions_m(sources: tuple[GasSource, ...]) -> NDArray[np.float64]:
    return np.array([source.position_world_m for source in sources], np.float64)


def _common_power(sources: tuple[GasSource, ...]) -> int:
    powers = {source.buoyancy.power for source in sources if source.buoyancy.coefficient}
    if len(powers) > 1 or not powers <= {1, 3}:
        raise ModelError(f"fields: expected buoyancies of one power of the size, 1 or 3, were {sorted(powers)}.")
    return powers.pop() if powers else 1


def _check_sources(environment: Environment, sources: tuple[GasSource, ...]) -> None:
    problems: list[str] = []
    for i, source in enumerate(sources):
        cell = environment.grid.cell_of(np.array(source.position_world_m))
        if not environment.grid.contains_cell(cell):
            found = "outside the room"
        elif environment.occupancy[tuple(cell)] == Cell.SOLID:
            found = "inside a solid"
        else:
            continue
        place = ", ".join(f"{x:g}" for x in source.position_world_m)
        problems.append(f"gas.sources[{i}].position_m: expected a place in the air, was ({place}), {found}.")
    if problems:
        raise ScenarioError("\n".join(problems))


def _check_wind(environment: Environment) -> None:
    velocity_m_s = environment.wind.velocity_m_s
    expected = (*environment.grid.shape, 3)
    if velocity_m_s.shape[1:] != expected or velocity_m_s.dtype != np.float32 or len(velocity_m_s) == 0:
        raise ModelError(
            f"fields: expected wind frames of shape (t, {', '.join(map(str, expected))}) float32, "
            f"was {velocity_m_s.shape} {velocity_m_s.dtype}."
        )
