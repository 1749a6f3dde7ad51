"""Environments, instruments and gas of cases as records for the kernels."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba.core.errors import NumbaError
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import distance
from gslcosim.base.ticks import NS_PER_S, ticks_from_seconds
from gslcosim.environment.model import Environment
from gslcosim.environment.openings import solid_boxes
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas import FilamentGasSpec
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.models.sensors import (
    BumpSensorSpec,
    LidarSensorSpec,
    OnBoardSensorSpec,
    RaySensorSpec,
    SensorSpec,
)
from gslcosim_formats.gaussian_plume import (
    KNOT_CORRELATION,
    KNOTS_PER_CORRELATION_TIME,
    GaussianPlumeGasSpec,
    MeanderingPlumeGasSpec,
)
from gslcosim_formats.stored_gas.frame_formats import GasFrame
from gslcosim_formats.stored_gas.model import PlaybackGasSpec, load_stored_gas
from gslcosim_search.learned.encoding import CHANNELS, N_SECTORS, Channel, encode_ranges
from gslcosim_services.fields.filament.plume import Filaments
from gslcosim_services.fields.filament_field import MIN_READINGS_FOR_INDEX
from gslcosim_services.fields.gas_setup import GasSetup, GasTiming, gas_seed, gas_timing, list_gas_names
from gslcosim_services.fields.mixing_ratio import CUTOFF_SIGMA, build_solid_sums, strength_ppm_m3
from gslcosim_services.fields.models.filament_gas import build_cached_plume, build_gas_model
from gslcosim_services.fields.spatial_index import FilamentIndex
from gslcosim_services.fields.tape import CachedPlume, GasTape, tape_hash
from gslcosim_services.sensing.briefing import find_sensor_kind
from gslcosim_services.sensing.models.base import (
    KernelEstimator,
    KernelSensorKind,
    SensorKind,
    estimate_name,
    is_imperfect,
    read_errors,
)
from gslcosim_services.sensing.models.range_finders import new_contacts, ray_directions_body
from gslcosim_services.sensing.ray_scene import BIN_M, RayScene
from gslcosim_training.batch import batch_records as records
from gslcosim_training.batch.gas_readings import sort_frames_inplace
from gslcosim_training.batch.plume_kernels import PLUME_RECORD, build_plume_records
from gslcosim_training.batch.scalar_compilation import (
    find_advance_address,
    find_encode_address,
    find_estimate_address,
)

# Edge of the blocks in which the boxes are looked for that a vehicle may touch [m].
_BLOCK_M = 0.5
# What rounding may add to a vehicle's reach [m].
_ROUNDING_M = 1e-6
ELSE = "Change it, or fly single environments of gslcosim/Search-v0."
# Edge of the columns into which filaments are sorted [m].
_COLUMN_M = 1.0


@dataclass
class BatchRooms:
    """Rooms by what decides them; `kept` holds the arrays that the records point into."""

    rows: list[NDArray[np.void]] = field(default_factory=list[NDArray[np.void]])
    kept: list[object] = field(default_factory=list[object])
    _known: dict[tuple[str, float], int] = field(default_factory=dict[tuple[str, float], int])

    def number_of(self, scenario: Scenario, environment: Environment, radius_m: float) -> int:
        """Return the number of a scenario's room for vehicles of a radius [m]."""
        key = (environment.content_hash, radius_m)
        if key not in self._known:
            self._known[key] = len(self.rows)
            self.rows.append(self._row(environment, radius_m))
            self._fill_rays(self.rows[-1], RayScene(scenario, environment))
        return self._known[key]

    def array(self) -> NDArray[np.void]:
        """Return the (n,) records of `ROOM`."""
        return np.array(self.rows, records.ROOM)

    def _row(self, environment: Environment, radius_m: float) -> NDArray[np.void]:
        row = np.zeros((), records.ROOM)
        grid, wind = environment.grid, environment.wind
        row["origin_m"], row["max_m"], row["cell_m"], row["shape"] = grid.origin_m, grid.max_m, grid.cell_m, grid.shape
        row["occupancy"] = self._address(np.ascontiguousarray(environment.occupancy, np.uint8))
        row["wind"] = self._address(np.ascontiguousarray(wind.velocity_m_s, np.float32))
        row["wind_shape"] = wind.velocity_m_s.shape[:4]
        row["wind_period_s"], row["wind_loops"] = wind.period_s, wind.is_looping
        boxes_m = np.array([(*box.min_m, *box.max_m) for box in solid_boxes(environment)], np.float64)
        row["boxes_m"], row["n_boxes"] = self._address(boxes_m), len(boxes_m)
        first, members, shape = _near(boxes_m, np.array(grid.origin_m), np.array(grid.max_m), radius_m)
        row["near_origin_m"], row["near_block_m"], row["near_shape"] = grid.origin_m, _BLOCK_M, shape
        row["near_first"], row["near_members"] = self._address(first), self._address(members)
        row["solid_sums"] = self._address(build_solid_sums(np.ascontiguousarray(environment.occupancy, np.uint8)))
        return row

    def _fill_rays(self, row: NDArray[np.void], rays: RayScene) -> None:
        boxes_m, first, members = rays.boxes
        row["ray_boxes_m"], row["n_ray_boxes"] = self._address(boxes_m), len(boxes_m)
        row["ray_first"], row["ray_members"] = self._address(first), self._address(members)
        row["ray_origin_m"], row["ray_shape"] = rays.bins
        row["ray_bin_m"] = BIN_M

    def _address(self, array: NDArray) -> int:
        self.kept.append(array)
        return int(array.ctypes.data)


# Which boxes are within reach of a vehicle somewhere in each block, as first and members.
def _near(
    boxes_m: NDArray[np.float64], low_m: NDArray[np.float64], high_m: NDArray[np.float64], radius_m: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64]]:
    shape = np.maximum(np.ceil((high_m - low_m) / _BLOCK_M).astype(np.int64), 1)
    reach_m = radius_m + _ROUNDING_M
    blocks: list[NDArray[np.int64]] = []
    members: list[NDArray[np.int32]] = []
    for n, box_m in enumerate(boxes_m):
        begin = np.clip(np.floor((box_m[:3] - reach_m - low_m) / _BLOCK_M).astype(np.int64), 0, shape)
        end = np.clip(np.floor((box_m[3:] + reach_m - low_m) / _BLOCK_M).astype(np.int64) + 1, 0, shape)
        i, j, k = (np.arange(a, b) for a, b in zip(begin.tolist(), end.tolist(), strict=True))
        inside = ((i[:, None, None] * shape[1] + j[None, :, None]) * shape[2] + k[None, None, :]).ravel()
        blocks.append(inside)
        members.append(np.full(len(inside), n, np.int32))
    all_blocks, all_members = np.concatenate(blocks), np.concatenate(members)
    order = np.argsort(all_blocks, kind="stable")
    n_blocks = int(np.prod(shape))
    first = np.zeros(n_blocks + 1, np.int32)
    first[1:] = np.cumsum(np.bincount(all_blocks, minlength=n_blocks))
    return first, np.ascontiguousarray(all_members[order]), shape


class BatchInstruments:
    """The sensors of one agent as records of `INSTRUMENT`, the places where they are, and their streams' names.

    `n_memory` is how many numbers a search keeps of their states and samples of late, `kept` holds the arrays that the
    records point into. Gas and wind are sampled at the first `n_sampled` places, rays begin at any.

    Args:
        agent: The agent.
        scenario: Its scenario.
        gases: Names of the gases, in the order of the field's columns.
        numbers: Names of the numbers of an observation, in order.
        first_name: Where the names of its streams begin among those of all cases.
    """

    def __init__(
        self, agent: AgentSpec, scenario: Scenario, gases: tuple[str, ...], numbers: tuple[str, ...], first_name: int
    ) -> None:
        self._scenario = scenario
        self._gases = gases
        self._numbers = numbers
        self._tick_s = scenario.tick_ns / NS_PER_S
        self.n_memory = 0
        self.kept: list[NDArray[np.float64]] = []
        self.rows = np.zeros(len(agent.sensors), records.INSTRUMENT)
        self.names = b""
        sampled = [sensor.mount_m for sensor in agent.sensors if not isinstance(sensor, OnBoardSensorSpec)]
        places: dict[Vec3, int] = {place_m: i for i, place_m in enumerate(dict.fromkeys(sampled))}
        self.n_sampled = len(places)
        for row, sensor in zip(self.rows, agent.sensors, strict=True):
            name = f"sensing.{agent.name}.{sensor.name}".encode()
            row["first_name"], row["n_name"] = first_name + len(self.names), len(name)
            self.names += name
            row["place"] = places.setdefault(sensor.mount_m, len(places))
            self._fill(row, sensor, find_sensor_kind(scenario, sensor.model))
        self.places_m: NDArray[np.float64] = np.array(list(places), np.float64).reshape(-1, 3)

    def _fill(self, row: Any, sensor: SensorSpec, kind: SensorKind) -> None:
        row["first_memory"] = self.n_memory
        match sensor:
            case RaySensorSpec():
                self._fill_rays(row, sensor)
            case BumpSensorSpec():
                row["kind"], row["n_values"] = records.BUMP, 1
                self._keep(row, "new_state", "n_state", new_contacts(sensor, self._tick_s))
                self._encode(row, sensor, CHANNELS[kind.quantity, kind.unit])
            case _ if isinstance(kind, KernelSensorKind):
                self._fill_kernel(row, sensor, kind)
            case _:
                raise UsageError(
                    f"agents[0].sensors: model: expected a sensor of gas, wind or ranges in a batch, was {kind.name}. "
                    f"{ELSE}"
                )
        self.n_memory += int(row["n_state"])
        self._fill_errors(row, sensor, kind)
        if sensor.delay_s:
            self._delay(row, sensor, kind)

    def _fill_rays(self, row: Any, sensor: RaySensorSpec) -> None:
        directions = ray_directions_body(sensor)
        row["kind"], row["max_range_m"], row["own_noise"] = records.RANGES, sensor.max_range_m, sensor.noise_std
        self._keep(row, "directions", "n_rays", directions.reshape(-1, 3))
        n_numbers = len(directions)
        if isinstance(sensor, LidarSensorSpec):
            row["n_azimuths"], n_numbers = directions.shape[1], min(directions.shape[1], N_SECTORS)
            row["n_sectors"] = n_numbers
            self._keep(row, "new_state", "n_state", (0.0,) * n_numbers)
        else:
            row["n_values"] = n_numbers
        names = tuple(f"closeness_{i}" for i in range(n_numbers))
        self._encode(row, sensor, Channel(names, encode_ranges))

    def _fill_kernel(self, row: Any, sensor: SensorSpec, kind: KernelSensorKind) -> None:
        kernel = kind.kernel(sensor, self._gases, self._tick_s)
        if kernel.n_values > records.MOST_VALUES:
            raise UsageError(
                f"agents[0].sensors: model: expected at most {records.MOST_VALUES} values of a reading in a batch, was "
                f"{kernel.n_values} of {kind.name}. {ELSE}"
            )
        row["kind"], row["n_values"] = records.KERNEL, kernel.n_values
        row["advance"] = _compile(find_advance_address, kernel.advance, kind)
        self._keep(row, "parameters", "n_parameters", kernel.parameters)
        self._keep(row, "new_state", "n_state", kernel.state)
        self._encode(row, sensor, CHANNELS.get((kind.quantity, kind.unit)))
        estimator = kind.estimator(self._scenario.gas.gas) if kind.estimator is not None else None
        if estimator is None:
            return
        if not isinstance(estimator, KernelEstimator):
            raise UsageError(
                f"agents[0].sensors: model: expected a KernelEstimator in a batch, was {type(estimator).__name__} of "
                f"{kind.name}. {ELSE}"
            )
        row["estimate"] = _compile(find_estimate_address, estimator.estimate, kind)
        self._keep(row, "estimate_parameters", "n_estimate_parameters", estimator.parameters)
        channel = CHANNELS.get((estimator.quantity, estimator.unit))
        if channel is not None:
            row["encode_estimate"] = find_encode_address(channel.encode)
            row["estimate_number"] = self._numbers.index(f"{estimate_name(sensor.name)}.{channel.names[0]}")

    # Readings without a channel are left out of observations, as `ObservationVector` does.
    def _encode(self, row: Any, sensor: SensorSpec, channel: Channel | None) -> None:
        if channel is not None:
            row["encode"], row["n_numbers"] = find_encode_address(channel.encode), len(channel.names)
            row["first_number"] = self._numbers.index(f"{sensor.name}.{channel.names[0]}")

    def _keep(self, row: Any, name: str, n_name: str, numbers: tuple[float, ...] | NDArray[np.float64]) -> None:
        array = np.array(numbers, np.float64)
        self.kept.append(array)
        row[name], row[n_name] = array.ctypes.data, len(array)

    def _delay(self, row: Any, sensor: SensorSpec, kind: SensorKind) -> None:
        if kind.is_on_board:
            raise UsageError(
                f"agents[0].sensors: delay_s: expected 0 in a batch for a {sensor.model}, was {sensor.delay_s:g}. "
                f"{ELSE}"
            )
        row["delay_ticks"] = ticks_from_seconds(sensor.delay_s, self._scenario.tick_ns)
        self.n_memory += (int(row["delay_ticks"]) + 1) * records.SAMPLE_LENGTH

    def _fill_errors(self, row: Any, sensor: SensorSpec, kind: SensorKind) -> None:
        tick_ns, errors = self._scenario.tick_ns, read_errors(kind, sensor)
        row["has_errors"] = is_imperfect(kind, sensor)
        row["n_with_errors"] = row["n_values"] if kind.n_with_errors is None else kind.n_with_errors
        row["noise_std"], row["bias"], row["drift_per_s"] = errors.noise_std, errors.bias, errors.drift_per_s
        row["gain_spread"], row["drift_spread_per_s"] = errors.gain_spread, errors.drift_spread_per_s
        row["resolution"] = errors.resolution
        row["max_value"], row["least_value"] = errors.max_value, kind.least_value
        row["period_ticks"] = ticks_from_seconds(sensor.period_s, tick_ns) if sensor.period_s else 1
        row["warm_up_ticks"] = ticks_from_seconds(sensor.warm_up_s, tick_ns)


def _compile(find_address: Callable[[Any], int], kernel: Any, kind: SensorKind) -> int:
    try:
        return find_address(kernel)
    except NumbaError as error:
        raise UsageError(
            f"sensor {kind.name}: expected a scalar kernel that can be compiled, was {kernel.__module__}."
            f"{kernel.__qualname__}. See gslcosim.base.scalar_kernels for what may stand in it.\n{error}"
        ) from error


class BatchGas:
    """Gathers the gas of cases; `kept` holds the arrays that the records of tapes and frames point into.

    `strengths` and `gas_of_source` have the sources of filaments of all cases, `most_filaments` is how many the largest
    frame of all tapes has.
    """

    def __init__(self) -> None:
        self.plumes: list[NDArray[np.void]] = []
        self.tapes: list[NDArray[np.void]] = []
        self.strengths: list[float] = []
        self.gas_of_source: list[int] = []
        self.kept: list[object] = []
        self.most_filaments = 1
        self.frames: list[NDArray[np.void]] = []
        self.frame_of_update: list[int] = []
        self._known: dict[str, int] = {}
        self._known_frames: dict[tuple[str, str, int], int] = {}
        self._known_updates: dict[str, int] = {}
        self._n_plumes = 0

    def plume_array(self) -> NDArray[np.void]:
        """Return the (n,) records of `PLUME_RECORD`."""
        return np.concatenate([np.zeros(1, PLUME_RECORD), *self.plumes])

    def add(self, case: Any, scenario: Scenario, environment: Environment) -> None:
        """Write the gas of a case into its record, but for where names and knots of meandering plumes are."""
        gas, timing = scenario.gas, gas_timing(scenario)
        case["n_gases"], case["warm_up_s"] = len(list_gas_names(gas)), gas.warm_up_s
        case["gas_ticks_per_step"] = timing.ticks_per_step
        if isinstance(gas, GaussianPlumeGasSpec | MeanderingPlumeGasSpec):
            plumes = build_plume_records(gas, GasSetup(scenario=scenario, environment=environment))
            # The first record is nobody's.
            case["gas"], case["first_plume"], case["n_plumes"] = records.STEADY_PLUMES, self._n_plumes + 1, len(plumes)
            self._n_plumes += len(plumes)
            self.plumes.append(plumes)
            if isinstance(gas, MeanderingPlumeGasSpec):
                _fill_wandering(case, gas, timing, environment, float(plumes["speed_m_s"].min()))
            return
        if isinstance(gas, PlaybackGasSpec):
            self._add_stored(case, gas, timing, environment)
            return
        n_readings = int(case["n_sampled"]) * timing.ticks_per_step
        self._add_tape(case, scenario, environment, is_indexed=n_readings >= MIN_READINGS_FOR_INDEX)

    # The seed has no meaning for it: which frame holds when is known beforehand.
    def _add_stored(self, case: Any, gas: PlaybackGasSpec, timing: GasTiming, environment: Environment) -> None:
        stored, grid = load_stored_gas(gas), environment.grid
        index = FilamentIndex(min_m=grid.origin_m, max_m=grid.max_m)
        n_ticks = ticks_from_seconds(float(case["time_limit_s"]), int(case["tick_ns"])) + 1
        n_updates = n_ticks // timing.ticks_per_step + 1
        case["gas"], case["first_update"], case["n_updates"] = (
            records.FRAMES, len(self.frame_of_update), n_updates,
        )  # fmt: skip
        case["cutoff_sigma"] = CUTOFF_SIGMA
        for update in range(n_updates):
            time_s = (timing.warm_up_steps + update * timing.steps_per_tick) * timing.step_s
            number = stored.number_at(time_s)
            if number is None:
                self.frame_of_update.append(-1)
                continue
            key = (environment.content_hash, repr(gas.playback), number)
            if key not in self._known_frames:
                self._known_frames[key] = len(self.frames)
                self.frames.append(self._frame_row(stored.frame(number), index))
            self.frame_of_update.append(self._known_frames[key])

    def _frame_row(self, frame: GasFrame, index: FilamentIndex) -> NDArray[np.void]:
        row, grid = np.zeros((), records.FRAME), frame.grid
        if frame.filaments is None:
            ppm = frame.mixing_ratio_ppm
            assert ppm is not None, "a frame has one or the other"
            row["shape"], row["origin_m"], row["cell_m"] = ppm.shape, grid.origin_m, grid.cell_m
            row["is_plane"], row["n_gases"] = frame.is_plane, 1
            self._keep(row, "ppm", np.ascontiguousarray(ppm, np.float32))
            return row
        return self._filaments_row(frame.filaments, index)

    def _filaments_row(self, filaments: Filaments, index: FilamentIndex) -> NDArray[np.void]:
        row = np.zeros((), records.FRAME)
        index.build(filaments)
        blocks, columns = index.tables
        n = len(filaments.sigma_m)
        row["n_gases"] = filaments.n_gases
        row["n_filaments"], row["largest_of_all_m"] = n, blocks.largest_sigma_m.max()
        row["n_blocks"], row["block_m"], row["block_origin_m"] = blocks.n_blocks, blocks.block_m, blocks.origin_m
        for name in ("x", "y", "z", "exponent_per_m2", "centre_ppm", "gas"):
            self._keep(row, name, getattr(columns, name)[:n].copy())
        self._keep(row, "first", blocks.first.copy())
        self._keep(row, "largest_sigma_m", blocks.largest_sigma_m.copy())
        self.most_filaments = max(self.most_filaments, n)
        return row

    def _keep(self, row: Any, name: str, array: NDArray[Any]) -> None:
        row[name] = array.ctypes.data
        self.kept.append(array)

    # A single run sums few readings of a step as they are on tape, and sorts the filaments by place for many.
    def _add_tape(self, case: Any, scenario: Scenario, environment: Environment, *, is_indexed: bool) -> None:
        seed = gas_seed(scenario, scenario.seed)
        plume = build_cached_plume(scenario, environment)
        plume.reset(seed)
        case["cutoff_sigma"] = build_gas_model(scenario, environment).cutoff_sigma
        key = tape_hash(scenario, environment, seed)
        if is_indexed:
            case["gas"], case["n_updates"] = records.FRAMES, plume.tape.n_frames
            if key not in self._known_updates:
                self._known_updates[key] = len(self.frame_of_update)
                self._add_sorted_frames(plume, environment)
            case["first_update"] = self._known_updates[key]
            return
        amount_mol, gas_index = plume.sources
        case["gas"], case["first_plume"], case["n_plumes"] = records.FILAMENTS, len(self.strengths), len(amount_mol)
        self.strengths += strength_ppm_m3(amount_mol).tolist()
        self.gas_of_source += gas_index.tolist()
        if key not in self._known:
            self._known[key] = len(self.tapes)
            self.tapes.append(self._tape_row(plume.tape, environment))
        case["tape"] = self._known[key]

    def _add_sorted_frames(self, plume: CachedPlume, environment: Environment) -> None:
        grid = environment.grid
        index = FilamentIndex(min_m=grid.origin_m, max_m=grid.max_m)
        for number in range(plume.tape.n_frames):
            self.frame_of_update.append(len(self.frames))
            self.frames.append(self._filaments_row(plume.filaments_of_frame(number), index))

    def _tape_row(self, tape: GasTape, environment: Environment) -> NDArray[np.void]:
        first, rows, sources = tape.arrays
        grid = environment.grid
        sides_m = np.subtract(grid.max_m, grid.origin_m)[:2]
        nx, ny = (int(n) for n in np.maximum(np.ceil(sides_m / _COLUMN_M), 1))
        starts = np.empty((tape.n_frames, nx * ny + 1), np.int32)
        members = np.empty(len(rows), np.int32)
        largest_m = np.empty(tape.n_frames, np.float32)
        origin_m = np.array(grid.origin_m[:2], np.float64)
        numbers = np.empty((4, len(rows)), np.float32)
        sort_frames_inplace(first, rows, origin_m, _COLUMN_M, nx, ny, starts, members, numbers, largest_m)
        self.most_filaments = max(self.most_filaments, int(np.diff(first).max(initial=1)))
        row = np.zeros((), records.TAPE)
        row["n_frames"], row["n_rows"] = tape.n_frames, len(rows)
        row["origin_m"], row["column_m"], row["shape"] = origin_m, _COLUMN_M, (nx, ny)
        arrays = {
            "first": first, "starts": starts, "members": members, "sorted_numbers": numbers,
            "largest_sigma_m": largest_m,
        }  # fmt: skip
        if sources is not None:
            arrays["sources"] = sources
        for name, array in arrays.items():
            self._keep(row, name, array)
        return row


def is_gas_supported(scenario: Scenario) -> bool:
    """Return True if a scenario's gas can be batched."""
    models = GaussianPlumeGasSpec | MeanderingPlumeGasSpec | FilamentGasSpec | PlaybackGasSpec
    return isinstance(scenario.gas, models) and not scenario.gas.rotor_downwash


def list_wander_streams(scenario: Scenario) -> bytes:
    """Return the names of the streams of meandering plumes, one after the other; nothing for other gas."""
    if not isinstance(scenario.gas, MeanderingPlumeGasSpec):
        return b""
    return "".join(f"fields.meander.{i}.{axis}" for i in range(len(scenario.gas.sources)) for axis in "yz").encode()


def _fill_wandering(
    case: Any, gas: MeanderingPlumeGasSpec, timing: GasTiming, environment: Environment, speed_m_s: float
) -> None:
    case["gas"] = records.MEANDERING_PLUMES
    case["gas_steps_per_tick"], case["gas_step_s"] = timing.steps_per_tick, timing.step_s
    case["warm_up_steps"], case["gas_seed"] = timing.warm_up_steps, -1 if gas.seed is None else gas.seed
    case["knot_s"], case["wander_rho"] = gas.plume.meander_s / KNOTS_PER_CORRELATION_TIME, KNOT_CORRELATION
    case["instantaneous_frac"] = gas.plume.instantaneous_frac
    # As many as pass while the air crosses the room, and a few.
    crosses_s = (distance(environment.grid.origin_m, environment.grid.max_m) + 1.0) / speed_m_s
    case["n_knots"] = math.ceil(crosses_s / case["knot_s"]) + 4
