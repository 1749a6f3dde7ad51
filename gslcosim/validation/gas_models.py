"""Plumes of our gas models in an open field, as records at points that the statistics of plumes score.

`record_plume` runs any block of `gas:` in even wind; `score_plume` gives its figures at each distance with intervals.
`GAS_SETTINGS` are the settings that are compared.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import Cell, Environment, Grid, WindFrames
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.validation.plume_statistics import PlumeScores, RecordSettings, score_record
from gslcosim_services.fields.gas_builder import build_gas_field

STEP_S = 0.1
WIND_M_S = 1.0
SOURCE_M = (3.0, 20.0, 4.0)
DISTANCES_M = (2.0, 4.0, 8.0, 16.0, 32.0)
THRESHOLD_PER_MEAN = 0.5
"""A whiff is what is above half the record's mean; conditional intensity depends on it."""
WARM_UP_S = 60.0

_EDDIES: Mapping[str, Any] = {"kind": "given", "intensity_frac": 0.3, "length_m": 2.0}
_GUSTS: Mapping[str, Any] = {"wind_m_s": (WIND_M_S, 0.0, 0.0), "gust_std_m_s": 0.3, "gust_period_s": 30.0}
GAS_SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "filament": {"model": "filament"},
    "filament, turbulence": {"model": "filament", "turbulence": _EDDIES},
    "farrell": {"model": "farrell", "eddy_diffusivity_m2_s": 0.005, "farrell": _GUSTS},
    "farrell, turbulence": {"model": "farrell", "turbulence": _EDDIES, "farrell": _GUSTS},
    "meandering_plume": {"model": "meandering_plume", "plume": {"wind_m_s": (WIND_M_S, 0.0, 0.0)}},
}
"""Blocks of `gas:` without sources, by names for people."""


def build_gas_scenario(gas: Mapping[str, Any], *, name: str, seed: int) -> Scenario:
    """Return a scenario for gas alone, of which a gas field is built beside an environment of its own.

    Args:
        gas: The block `gas:`.
        name: Of the scenario.
        seed: Of the scenario.
    """
    return Scenario.model_validate(
        {
            "schema": "gslcosim/scenario/1",
            "name": name,
            "seed": seed,
            "environment": {"layout": {}},
            "gas": gas,
            # A scenario needs an agent; it does not take part.
            "agents": [
                {
                    "name": "nobody",
                    "start": {"attach": True},
                    "vehicle": {"start_m": (1, 1, 0.2)},
                    "sensors": [{"model": "pid", "name": "nose"}],
                }
            ],
        }
    )


def record_plume(
    gas: Mapping[str, Any], *, seconds: float, seed: int = 1, distances_m: Sequence[float] = DISTANCES_M
) -> NDArray[np.float64]:
    """Return the (n, n_distances) mixing ratios [ppm], 10 a second, on the axis down the mean wind of 1 m/s.

    Args:
        gas: A block of `gas:` without sources.
        seconds: Length of the record [s].
        seed: Of the gas.
        distances_m: From the source [m], up to 38.
    """
    source = {"position_m": SOURCE_M, "filaments_per_s": 10}
    scenario = build_gas_scenario({**gas, "sources": [source], "step_s": STEP_S}, name="open_field", seed=seed)
    field = build_gas_field(scenario, open_field())
    field.reset(seed)
    points_m = np.array(SOURCE_M) + np.outer(distances_m, (1.0, 0.0, 0.0))
    field.advance(round(WARM_UP_S / STEP_S))
    record = np.empty((round(seconds / STEP_S), len(distances_m)))
    for row in record:
        field.advance(1)
        row[:] = field.mixing_ratio_ppm_at(points_m)[:, 0]
    return record


def score_plume(record: NDArray[np.float64]) -> tuple[PlumeScores, ...]:
    """Return the figures of each column of a record of `record_plume`, with intervals."""
    return tuple(
        score_record(column, RecordSettings(step_s=STEP_S, threshold=THRESHOLD_PER_MEAN * float(column.mean())))
        for column in record.T
    )


def open_field() -> Environment:
    """Return a field of 42 x 40 x 12 m in even wind along x, whose sides and top let gas out."""
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, shape=(84, 80, 24))
    occupancy = np.zeros(grid.shape, np.uint8)
    for border in (occupancy[0], occupancy[-1], occupancy[:, 0], occupancy[:, -1], occupancy[:, :, -1]):
        border[:] = Cell.OUTLET
    velocity_m_s = np.zeros((1, *grid.shape, 3), np.float32)
    velocity_m_s[..., 0] = WIND_M_S
    return Environment(
        name="field",
        grid=grid,
        occupancy=occupancy,
        wind=WindFrames(velocity_m_s=velocity_m_s),
        boxes=(),
        openings=(),
        content_hash="field",
    )
