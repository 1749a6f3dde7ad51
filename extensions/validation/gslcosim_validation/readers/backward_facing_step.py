"""Flow behind a step: `profiles.csv`, `skin_friction.csv`, `geometry.json` (Jovic and Driver 1994)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim_validation.readers.columns import read_columns
from gslcosim_validation.readers.documents import read_document


@dataclass(frozen=True)
class StepProfile:
    """One vertical: distance from the step over its height, (n,) heights over it, mean wind along x over U0."""

    x_over_h: float
    y_over_h: NDArray[np.float64]
    u_over_u0: NDArray[np.float64]


@dataclass(frozen=True)
class StepFlow:
    """A channel that widens at a step, with verticals of the mean wind and the friction at the wall behind it.

    `step_height_m` h [m]; `inlet_m_s` U0 [m/s]; `reynolds` U0 h / nu; `upstream_height_h`, `downstream_height_h` of
    the channel [h]; `reattachment_x_over_h` where the flow comes back to the wall [h]; `friction_x_over_h`,
    `friction_cf` (m,) places and coefficients.
    """

    step_height_m: float
    inlet_m_s: float
    reynolds: float
    upstream_height_h: float
    downstream_height_h: float
    reattachment_x_over_h: float
    profiles: tuple[StepProfile, ...]
    friction_x_over_h: NDArray[np.float64]
    friction_cf: NDArray[np.float64]


def read_backward_facing_step(folder: Path) -> StepFlow:
    """Return the set in a folder."""
    geometry = read_document(folder / "geometry.json")
    table, friction = read_columns(folder / "profiles.csv"), read_columns(folder / "skin_friction.csv")
    x = table.numbers("x_over_h")
    y, u = table.numbers("y_over_h"), table.numbers("u_over_u0")
    return StepFlow(
        step_height_m=1e-3 * geometry.number("step_height_h_mm"),
        inlet_m_s=geometry.number("u0_m_s"),
        reynolds=geometry.number("reynolds_h"),
        upstream_height_h=geometry.number("upstream_height_h"),
        downstream_height_h=geometry.number("downstream_height_h"),
        reattachment_x_over_h=geometry.number("reattachment_x_over_h"),
        profiles=tuple(StepProfile(place, y[x == place], u[x == place]) for place in dict.fromkeys(x.tolist())),
        friction_x_over_h=friction.numbers("x_over_h"),
        friction_cf=friction.numbers("cf"),
    )
