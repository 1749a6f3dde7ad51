"""Gas of cases for the kernels: plumes in closed form, and tapes of filaments, each tape once."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas import FilamentGasSpec, GaussianPlumeGasSpec, MeanderingPlumeGasSpec
from gslcosim.training.batch import batch_records as records
from gslcosim.training.batch.filament_tape import sort_frames_inplace
from gslcosim.training.batch.instruments import ELSE
from gslcosim_services.fields.concentration.filament_field import MIN_READINGS_FOR_INDEX
from gslcosim_services.fields.concentration.mixing_ratio import strength_ppm_m3
from gslcosim_services.fields.gas_setup import GasSetup, GasTiming, gas_seed, gas_timing, list_gas_names
from gslcosim_services.fields.models.filament_gas import build_cached_plume, build_gas_model
from gslcosim_services.fields.models.gaussian_plume import (
    KNOT_CORRELATION,
    KNOTS_PER_CORRELATION_TIME,
    PLUME_RECORD,
    build_plume_records,
)
from gslcosim_services.fields.stored.tape import GasTape, tape_hash

# Edge of the columns into which filaments are sorted [m].
_COLUMN_M = 1.0


class BatchGas:
    """Gathers the gas of cases; `kept` holds the arrays that the records of tapes point into.

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
        self._known: dict[str, int] = {}
        self._n_plumes = 0

    @property
    def tape_bytes(self) -> int:
        """Bytes that tapes take on disk, mapped into memory, and their order beside them in memory."""
        return sum(int(array.nbytes) for array in self.kept if isinstance(array, np.ndarray))

    def plume_array(self) -> NDArray[np.void]:
        """Return the (n,) records of `PLUME_RECORD`."""
        return np.concatenate([np.zeros(1, PLUME_RECORD), *self.plumes])

    def add(self, case: Any, scenario: Scenario, environment: Environment, n_places: int) -> None:
        """Write the gas of a case into its record, but for where names and knots of meandering plumes are.

        Raises:
            UsageError: the gas would be read in another order in a single flight.
        """
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
        n_readings = n_places * timing.ticks_per_step
        if n_readings >= MIN_READINGS_FOR_INDEX:
            raise UsageError(
                f"{scenario.name}: gas.step_s: expected fewer than {MIN_READINGS_FOR_INDEX} readings of filaments in "
                f"a step (places of sensors times ticks), was {n_readings}. {ELSE}"
            )
        self._add_tape(case, scenario, environment)

    def _add_tape(self, case: Any, scenario: Scenario, environment: Environment) -> None:
        seed = gas_seed(scenario, scenario.seed)
        plume = build_cached_plume(scenario, environment)
        plume.reset(seed)
        amount_mol, gas_index = plume.sources
        case["gas"], case["first_plume"], case["n_plumes"] = records.FILAMENTS, len(self.strengths), len(amount_mol)
        self.strengths += strength_ppm_m3(amount_mol).tolist()
        self.gas_of_source += gas_index.tolist()
        case["cutoff_sigma"] = build_gas_model(scenario, environment).cutoff_sigma
        key = tape_hash(scenario, environment, seed)
        if key not in self._known:
            self._known[key] = len(self.tapes)
            self.tapes.append(self._tape_row(plume.tape, environment))
        case["tape"] = self._known[key]

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
            row[name] = array.ctypes.data
            self.kept.append(array)
        return row


def is_gas_supported(scenario: Scenario) -> bool:
    """Return whether a scenario's gas can be batched."""
    models = GaussianPlumeGasSpec | MeanderingPlumeGasSpec | FilamentGasSpec
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
    crosses_s = (math.dist(environment.grid.origin_m, environment.grid.max_m) + 1.0) / speed_m_s
    case["n_knots"] = math.ceil(crosses_s / case["knot_s"]) + 4
