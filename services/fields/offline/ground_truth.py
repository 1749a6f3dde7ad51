"""Ground truth for scoring: the true sources and the true gas of an instant. For analysis, never for agents.

What agents import cannot reach this module (see .importlinter), and nothing of it is a message.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.base.ticks import NS_PER_S
from gslcosim.environment.model import Cell, Environment
from gslcosim.scenario import Scenario
from gslcosim_services.fields.concentration.mixing_ratio import CUTOFF_SIGMA
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_services.fields.gas_field import GasField, PointGrid
from gslcosim_services.fields.gas_setup import gas_seed, gas_timing, list_gas_names, mean_release_m3_s
from gslcosim_services.fields.offline.samplers import build_lattice


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

    def probability_of_gas(self, gas: str) -> NDArray[np.float64]:
        """Return one gas as a distribution over the points: (nx, ny, nz), sum 1; even over the air where there is none.

        Beliefs of agents are compared with it, for example by the earth mover's distance.
        """
        amount = self.mixing_ratio_ppm[self.gases.index(gas)]
        amount = amount if amount.sum() > 0.0 else self.is_air.astype(np.float64)
        return amount / amount.sum()


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

    Raises:
        ScenarioError: the scenario does not fit its room.
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
