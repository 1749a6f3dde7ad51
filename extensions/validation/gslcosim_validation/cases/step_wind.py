"""Wind behind a step beside measured profiles (Jovic and Driver 1994, Reynolds number 5,000)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.flow.patches import Inlet, Outlet, SlipWall
from gslcosim.flow.solve import Turbulence, solve_wind_report
from gslcosim_validation.readers.backward_facing_step import StepFlow, StepProfile
from gslcosim_validation.readers.columns import MeasuredDataError
from gslcosim_validation.results import Effort, Figure, Findings, Progress, plain_estimate

# Cells of the step's height.
CELLS: dict[Effort, int] = {"quick": 5, "full": 10}
MODELS: tuple[Turbulence, ...] = ("k_epsilon", "rng_k_epsilon")
LENGTH_H = 20.0
JUDGED_X_OVER_H = (4.0, 6.0, 10.0)
# Turbulence of the boundary layer before the step: its k is (0.06 U0)^2 x 1.5, from uu and vv of the first profile, and
# its eddies have 0.09 of its thickness of 1.17 h (Escudier 1966).
INLET_INTENSITY, INLET_LENGTH_H = 0.06, 0.09 * 1.17
# In step heights over U0.
END, MEAN_FROM = 200.0, 150.0


@dataclass(frozen=True, kw_only=True)
class StepWind:
    """Wind over a step of height 1 at U0 = 1.

    `u` (nx + 1, nz) on faces; `x` (nx + 1,) and `z` (nz,) their places, x from the step's edge.
    """

    u: NDArray[np.float64]
    x: NDArray[np.float64]
    z: NDArray[np.float64]

    @property
    def reattachment(self) -> float:
        """Position after which the wind at the floor stays downwind; nan if there is none."""
        behind = self.x > 0.05
        x, floor = self.x[behind], self.u[behind, 0]
        turns = np.flatnonzero((floor[:-1] < 0) & (floor[1:] >= 0))
        if not turns.size:
            return float("nan")
        i = turns[-1]
        return float(x[i] - floor[i] * (x[i + 1] - x[i]) / (floor[i + 1] - floor[i]))

    def along(self, profile: StepProfile) -> NDArray[np.float64]:
        """Return the wind at the heights of a measured profile."""
        column = [np.interp(profile.x_over_h, self.x, self.u[:, k]) for k in range(self.z.size)]
        return np.interp(profile.y_over_h, np.concatenate(([0.0], self.z)), np.concatenate(([0.0], column)))


def solve_step(flow: StepFlow, n_cells: int, turbulence: Turbulence) -> StepWind:
    """Solve the lower half of the channel, which is symmetric, from the first measured profile on.

    Args:
        flow: Geometry and profiles; the first profile, before the step, is the inlet.
        n_cells: Of the step's height.
    """
    before = [profile for profile in flow.profiles if profile.x_over_h < 0]
    if not before:
        raise MeasuredDataError("profiles.csv: expected a profile before the step (x_over_h below 0), found none.")
    inlet = before[0]
    cell = 1 / n_cells
    height = 0.5 * flow.downstream_height_h
    n_before = round(-inlet.x_over_h * n_cells)
    n_x, n_z = n_before + round(LENGTH_H * n_cells), round(height * n_cells)
    free = np.ones((n_x, 1, n_z), bool)
    free[:n_before, :, :n_cells] = False
    y, u = np.concatenate(([0.0], inlet.y_over_h)), np.concatenate(([0.0], inlet.u_over_u0))

    def profile_m_s(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.multiply.outer(np.interp(points_m[:, 2] - 1.0, y, u), (1.0, 0.0, 0.0))

    length = n_x * cell
    patches = [
        Inlet(
            min_m=(0, 0, 1),
            max_m=(0, cell, height),
            velocity_m_s=profile_m_s,
            turbulence_intensity=INLET_INTENSITY,
            turbulence_length_m=INLET_LENGTH_H,
        ),
        Outlet(min_m=(length, 0, 0), max_m=(length, cell, height)),
        SlipWall(min_m=(0, 0, 0), max_m=(length, 0, height)),
        SlipWall(min_m=(0, cell, 0), max_m=(length, cell, height)),
        SlipWall(min_m=(0, 0, height), max_m=(length, cell, height)),
    ]
    report = solve_wind_report(
        free,
        cell,
        patches,
        end_time_s=END,
        average_from_s=MEAN_FROM,
        turbulence=turbulence,
        nu_m2_s=1 / flow.reynolds,
    )
    return StepWind(
        u=report.face_velocity_m_s[0][:, 0].astype(np.float64),
        x=(np.arange(n_x + 1, dtype=np.float64) - n_before) * cell,
        z=(np.arange(n_z, dtype=np.float64) + 0.5) * cell,
    )


def measure(flow: StepFlow, effort: Effort, progress: Progress) -> Findings:
    """Return where the wind comes back to the floor, and its error on verticals, for each model of turbulence."""
    figures: list[Figure] = []
    winds: dict[str, StepWind] = {}
    for i, model in enumerate(MODELS):
        progress(model, i / len(MODELS))
        wind = winds[model] = solve_step(flow, CELLS[effort], model)
        words = {"model": model, "n_cells": CELLS[effort], "measured": flow.reattachment_x_over_h}
        figures.append(Figure("reattachment", plain_estimate(wind.reattachment), **words))
        for profile in flow.profiles:
            if profile.x_over_h in JUDGED_X_OVER_H:
                rms = float(np.sqrt(np.mean((wind.along(profile) - profile.u_over_u0) ** 2)))
                figures.append(Figure("profile", plain_estimate(rms), model=model, x_over_h=profile.x_over_h))
    return Findings(figures=figures, drawings={"profiles": lambda figure: _draw(figure, flow, winds)})


def _draw(figure: Any, flow: StepFlow, winds: Mapping[str, StepWind]) -> None:
    profiles = [profile for profile in flow.profiles if profile.x_over_h > 0]
    axes = figure.subplots(1, len(profiles), sharey=True)
    for each, profile in zip(axes, profiles, strict=True):
        each.plot(profile.u_over_u0, profile.y_over_h, "ko", ms=2, label="measured")
        for model, wind in winds.items():
            each.plot(wind.along(profile), profile.y_over_h, "-", lw=1, label=model)
        each.set(title=f"x = {profile.x_over_h:g} h", xlabel="U / U0")
    axes[0].set_ylabel("y / h")
    axes[0].legend(fontsize=5)
