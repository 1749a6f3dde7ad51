"""Intermittency of a plume along and across its axis, true and through a MOX sensor.

Run with `python docs/studies/plume_statistics.py [--seconds 1200] [--seed 1] [--plot FILE.png]`; plots need the extra
`report`. Filaments in Farrell's open field are looked at ten times a second at places down the mean wind and beside its
axis. For each place the table has, of the true mixing ratio and of what a TGS2600's resistance suggests:

    present       share of the time with more than 0.1 ppm: one minus the intermittency
    peak/mean     99.9th percentile over the mean
    std/mean      relative fluctuation
    bursts/min    how often the mixing ratio rises above the threshold

The sensor hardly notices less than its floor of 0.3 ppm, and its slow decay fills the pauses: near the axis, what it
suggests is hardly ever absent. Beside the axis its reading is often just above the floor, where noise and the walk of
its baseline make short bursts of their own: there it can show more bursts than there are.

Jones 1983 (Journal of Hazardous Materials 7, 87-112) measured such plumes outdoors: gas comes in short bursts
with long pauses, peaks exceed the mean many times, both more so beside the axis, and a slow instrument hides both.

Down the wind the plume first grows patchier, as it wanders by more than its width. Gusts of a period P and a standard
deviation s move it by no more than some s P / 2 pi, here 1.4 m; its own spread goes on growing, so that from some 16 m
on it fills the pauses again.
"""

import argparse
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.rng import stream
from gslcosim.contract.messages import GasAmount, MountSample
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.models.sensors import make_sensor_spec
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_services.sensing import SENSOR_MODELS
from gslcosim_services.sensing.models.mox import MOX_PARAMETERS, build_mox_kernel, estimate_ppm
from gslcosim_validation.gas_models import STEP_S, build_gas_scenario, open_field, record_field
from gslcosim_validation.plume_statistics import compute_moments

THRESHOLD_PPM = 0.1
FIELD_CELLS = (84, 60, 12)
SOURCE_M = (3.0, 15.0, 2.0)
DISTANCES_M = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
ACROSS_AT_M = 8.0
OFFSETS_M = (0.0, 1.0, 2.0, 3.0)
PLACES_M = tuple((distance_m, 0.0) for distance_m in DISTANCES_M) + tuple((ACROSS_AT_M, y) for y in OFFSETS_M)
# The field is as old as its slowest filament needs to leave it.
WARM_UP_S = 120.0
SENSOR = "tgs2600"
GAS = "ethanol"
PLOTTED = {
    "mean_ppm": "mean [ppm]",
    "present_frac": "present",
    "peak_to_mean": "peak / mean",
    "relative_std": "std / mean",
    "bursts_per_min": "bursts / min",
}
HEADINGS = "   mean  present  peak/mean  std/mean  bursts/min"


@dataclass(frozen=True, kw_only=True)
class Statistics:
    """Figures of one time series; see the module."""

    mean_ppm: float
    present_frac: float
    peak_to_mean: float
    relative_std: float
    bursts_per_min: float


def statistics_of(ppm: NDArray[np.float64], *, step_s: float = STEP_S) -> Statistics:
    """Return the figures of (n,) mixing ratios [ppm], `step_s` apart [s]; ratios of a series without gas are 0."""
    moments, is_present = compute_moments(ppm), ppm > THRESHOLD_PPM
    n_bursts = int((is_present[1:] & ~is_present[:-1]).sum())
    has_gas = moments.mean > 0
    return Statistics(
        mean_ppm=moments.mean,
        present_frac=float(is_present.mean()),
        peak_to_mean=float(np.percentile(ppm, 99.9)) / moments.mean if has_gas else 0.0,
        relative_std=moments.intensity if has_gas else 0.0,
        bursts_per_min=n_bursts / (len(ppm) * step_s) * 60.0,
    )


def true_series(*, seconds: float, seed: int) -> NDArray[np.float64]:
    """Return (n, n_places) true mixing ratios [ppm] over time at `PLACES_M`: down the mean wind, then across it."""
    field = build_gas_field(_scenario(seed), open_field(FIELD_CELLS))
    places_m = np.add(SOURCE_M, [(along_m, across_m, 0.0) for along_m, across_m in PLACES_M])
    return record_field(field, places_m, warm_up_s=WARM_UP_S, seconds=seconds)


def through_sensor(ppm: NDArray[np.float64], *, seed: int) -> NDArray[np.float64]:
    """Return the (n,) mixing ratios [ppm] that a MOX sensor's resistance suggests in (n,) true ones."""
    sensor = SENSOR_MODELS[SENSOR].build(
        make_sensor_spec(model=SENSOR, name="nose"), STEP_S, stream(seed, "study.nose")
    )
    parameters, found = build_mox_kernel(MOX_PARAMETERS[SENSOR], (GAS,), STEP_S).parameters, []
    for value in ppm.tolist():
        sample = MountSample(
            agent="study",
            sensor="nose",
            gases=(GasAmount(gas=GAS, mixing_ratio_ppm=value),),
            wind_world_m_s=(0.0, 0.0, 0.0),
        )
        found.append(estimate_ppm(parameters, sensor.read(sample, (0.0, 0.0, 0.0)).values))
    return np.array(found)


def table(truth: NDArray[np.float64], sensed: NDArray[np.float64]) -> str:
    """Return the table of both (n, n_places) series."""
    rows = ["    ".join(_row(statistics_of(series[:, i])) for series in (truth, sensed)) for i in range(len(PLACES_M))]
    along = [f"{x:6.0f} m  {row}" for (x, _), row in zip(PLACES_M, rows, strict=True)][: len(DISTANCES_M)]
    across = [f"{y:6.0f} m  {row}" for (_, y), row in zip(PLACES_M, rows, strict=True)][len(DISTANCES_M) :]
    return "\n".join(
        [
            f"{'':10}{'true mixing ratio':<52}{'as a TGS2600 suggests'}",
            f"distance  {HEADINGS}    {HEADINGS}",
            *along,
            f"beside the axis, {ACROSS_AT_M:.0f} m from the source",
            *across,
        ]
    )


def _row(found: Statistics) -> str:
    return (
        f"{found.mean_ppm:7.3f}  {found.present_frac:7.1%}  {found.peak_to_mean:9.1f}  {found.relative_std:8.2f}  "
        f"{found.bursts_per_min:10.2f}"
    )


def plot(truth: NDArray[np.float64], sensed: NDArray[np.float64], path: str) -> None:
    """Draw a minute at each distance, and the figures over the distance and beside the axis."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    n_distances = len(DISTANCES_M)
    figure, axes = plt.subplots(n_distances, 3, figsize=(15, 2 * n_distances), width_ratios=(2, 1, 1))
    _draw_minutes(axes[:, 0], truth, sensed)
    down, beside = slice(0, n_distances), slice(n_distances, None)
    _draw_figures(axes[:, 1], DISTANCES_M, truth[:, down], sensed[:, down], "distance [m]")
    _draw_figures(axes[:, 2], OFFSETS_M, truth[:, beside], sensed[:, beside], f"beside it at {ACROSS_AT_M:g} m [m]")
    for axis in axes[:-1, 1]:
        axis.set_xscale("log")
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _draw_minutes(axes: Any, truth: NDArray[np.float64], sensed: NDArray[np.float64]) -> None:
    n = min(len(truth), round(60.0 / STEP_S))
    time_s = np.arange(n) * STEP_S
    for i, distance_m in enumerate(DISTANCES_M):
        axes[i].plot(time_s, truth[:n, i], lw=0.8, label="true")
        axes[i].plot(time_s, sensed[:n, i], lw=0.8, label=f"{SENSOR.upper()} suggests")
        axes[i].set_ylabel(f"{distance_m:g} m: ppm")
    axes[0].legend(loc="upper right")
    axes[-1].set_xlabel("time [s]")


def _draw_figures(
    axes: Any, x: tuple[float, ...], truth: NDArray[np.float64], sensed: NDArray[np.float64], x_label: str
) -> None:
    for axis, (name, label) in zip(axes, PLOTTED.items(), strict=False):
        for series, what in ((truth, "true"), (sensed, SENSOR.upper())):
            axis.plot(x, [getattr(statistics_of(series[:, i]), name) for i in range(len(x))], "o-", label=what)
        axis.set_ylabel(label)
        axis.set_ylim(bottom=0.0)
    axes[len(PLOTTED) - 1].set_xlabel(x_label)
    for axis in axes[len(PLOTTED) :]:
        axis.axis("off")


def _scenario(seed: int) -> Scenario:
    gas = {
        "model": "farrell",
        "gas": GAS,
        "sources": [{"position_m": SOURCE_M, "filaments_per_s": 10, "release": {"kind": "poisson"}}],
        "step_s": STEP_S,
        "eddy_diffusivity_m2_s": 0.005,
        "farrell": {"wind_m_s": (1.0, 0.0, 0.0), "gust_std_m_s": 0.11, "gust_period_s": 30.0},
    }
    return build_gas_scenario(gas, name="plume_statistics", seed=seed)


def main() -> None:
    """Print the table and draw the plots."""
    parser = argparse.ArgumentParser(description="How patchy a plume is, and what a MOX sensor makes of it.")
    parser.add_argument("--seconds", type=float, default=1200.0, help="time to look at (default: 1200)")
    parser.add_argument("--seed", type=int, default=1, help="seed (default: 1)")
    parser.add_argument("--plot", metavar="FILE", help="also draw into this file; needs the extra `report`")
    arguments = parser.parse_args()
    truth = true_series(seconds=arguments.seconds, seed=arguments.seed)
    sensed = np.stack([through_sensor(truth[:, i], seed=arguments.seed) for i in range(len(PLACES_M))], axis=1)
    sys.stdout.write(table(truth, sensed) + "\n")
    if arguments.plot:
        plot(truth, sensed, arguments.plot)
        sys.stdout.write(f"plots: {arguments.plot}\n")


if __name__ == "__main__":
    main()
