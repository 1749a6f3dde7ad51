"""Leaks in an office: onset, growth and whiffs at sensors, in our wind and filaments (Örebro)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import Environment, Grid, Opening, WindFrames
from gslcosim.flow.patches import Inlet, Outlet
from gslcosim.flow.solve import solve_wind
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_validation.gas_models import build_gas_scenario
from gslcosim_validation.readers.room_sensors import RoomExperiment, RoomSensors
from gslcosim_validation.results import Effort, Figure, Findings, Progress, median_estimate, plain_estimate

Floats = NDArray[np.float64]

CELL_M = 0.25
STEP_S = 1.0
# A displacement supply: a guess within what the set's description allows; 180 m3/h, 1.9 changes of air an hour.
SUPPLY_M_S = 0.2
SUPPLY_SIZE_M = 0.5
# Cheng et al. 2011, doi:10.1021/es103080p: 0.001 to 0.013 m2/s in naturally ventilated rooms; their geometric mean.
EDDY_DIFFUSIVITY_M2_S = 0.0036
FILAMENTS_PER_S = 1.0
# First-order lag of a MOX sensor in its cage, "of seconds".
LAG_S = 5.0
# Sensors are not comparable with each other, so a sensor has seen gas at this share of its own high readings.
ONSET_SHARE, ONSET_NOISES, SMOOTH_S = 0.05, 5.0, 10.0
ONSET_WITHIN_S = 2400.0
# When whiffs are counted, and over which trends are taken away [s since gas was first seen].
LIVELY_S, TREND_S = (1800.0, 4800.0), 300.0
WHIFF_SHARE = 0.5
N_STRONGEST = 5
_RUN_S = 5400.0
_QUICK_EXPERIMENTS = 2


@dataclass(frozen=True)
class SensorFigures:
    """Figures of one experiment, of measured readings or of ours.

    `onset_s` (k,) since the release, nan without gas; `growth_s` from first gas (fifth sensor) to 63 %
    of the room mean's plateau; `intensity` (k,) standard deviation over mean without trends; `whiffs_per_min` (k,).
    """

    onset_s: Floats
    growth_s: float
    intensity: Floats
    whiffs_per_min: Floats


# An experiment, its figures, and ours.
_Pair = tuple[RoomExperiment, SensorFigures, SensorFigures]


def compute_sensor_figures(time_s: Floats, readings: Floats, *, quiet_until_s: float) -> SensorFigures:
    """Return the figures of (n, k) readings at (n,) equidistant times [s]; before `quiet_until_s` there is no gas."""
    step_s = float(np.median(np.diff(time_s)))
    quiet = time_s < quiet_until_s
    base = np.nanmean(readings[quiet], axis=0) if quiet.any() else np.zeros(readings.shape[1])
    noise = np.nanstd(readings[quiet], axis=0) if quiet.any() else np.zeros(readings.shape[1])
    above = np.nan_to_num(readings - base)
    smooth = _running_mean(above, max(1, round(SMOOTH_S / step_s)))
    early = (time_s >= quiet_until_s) & (time_s <= quiet_until_s + ONSET_WITHIN_S)
    high = np.percentile(above[early], 95.0, axis=0)
    seen = (smooth > np.maximum(ONSET_NOISES * noise, ONSET_SHARE * high)) & (time_s >= quiet_until_s)[:, None]
    onset_s = np.where(seen.any(axis=0), time_s[np.argmax(seen, axis=0)], np.nan)
    first_s = float(np.sort(onset_s)[min(4, len(onset_s) - 1)])
    mean = smooth.mean(axis=1)
    plateau = float(np.percentile(mean, 95.0))
    grown = (mean >= (1.0 - np.exp(-1.0)) * plateau) & (time_s >= first_s)
    lively = (time_s >= first_s + LIVELY_S[0]) & (time_s <= first_s + LIVELY_S[1])
    intensity = whiffs = np.full(readings.shape[1], np.nan)
    if lively.sum() * step_s > 2 * TREND_S:
        level = above[lively].mean(axis=0)
        # Sensors that hardly respond have no figure.
        level = np.where(level > ONSET_NOISES * noise, level, np.nan)
        rest = ((above - _running_mean(above, round(TREND_S / step_s))) / level)[lively]
        intensity = rest.std(axis=0)
        with np.errstate(invalid="ignore"):
            rises = (rest[1:] > WHIFF_SHARE) & (rest[:-1] <= WHIFF_SHARE)
        whiffs = np.where(np.isfinite(level), rises.sum(axis=0) / (lively.sum() * step_s / 60.0), np.nan)
    return SensorFigures(onset_s, float(time_s[np.argmax(grown)] - first_s), intensity, whiffs)


def _running_mean(values: Floats, n: int) -> Floats:
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    first = np.clip(np.arange(len(values)) - n // 2, 0, len(values))
    last = np.clip(np.arange(len(values)) + n - n // 2, 0, len(values))
    return (sums[last] - sums[first]) / (last - first)[:, None]


def build_room(room: RoomSensors) -> Environment:
    """Return the room on cells of 0.25 m with its wind: air enters low at x = 0 beside the supply, leaves above."""
    size_m = (*room.corners_m.max(axis=0), room.height_m)
    shape = tuple(int(np.ceil(length_m / CELL_M - 1e-9)) for length_m in size_m)
    grid = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=CELL_M, shape=(shape[0], shape[1], shape[2]))
    x_m, y_m = (CELL_M * np.arange(0.5, n) for n in shape[:2])
    free = np.repeat(_is_inside(room.corners_m, x_m, y_m)[:, :, None], shape[2], axis=2)
    # The wall x = 0 ends below the slanted one; the half cylinder at that one blows along the floor.
    top_m = float(room.corners_m[room.corners_m[:, 0] == room.corners_m[:, 0].min(), 1].max())
    high_m = CELL_M * np.floor(min(top_m, y_m[free[0, :, 0]].max() + 0.5 * CELL_M) / CELL_M)
    middle_m = CELL_M * np.round(room.corners_m.mean(axis=0) / CELL_M)
    ceiling_m = shape[2] * CELL_M
    supply = ((0.0, high_m - SUPPLY_SIZE_M, 0.0), (0.0, high_m, SUPPLY_SIZE_M))
    extract = ((*(middle_m - 0.25), ceiling_m), (*(middle_m + 0.25), ceiling_m))
    inflow = (SUPPLY_M_S, 0.0, 0.0)
    wind = solve_wind(
        free,
        CELL_M,
        [
            Inlet(min_m=supply[0], max_m=supply[1], velocity_m_s=inflow),
            Outlet(min_m=_vec(extract[0]), max_m=_vec(extract[1])),
        ],
    )
    return Environment(
        name="office",
        grid=grid,
        occupancy=(~free).astype(np.uint8),
        wind=WindFrames(velocity_m_s=wind[None]),
        boxes=(),
        openings=(
            Opening(name="supply", kind="inlet", min_m=supply[0], max_m=supply[1], velocity_m_s=inflow),
            Opening(name="extract", kind="outlet", min_m=_vec(extract[0]), max_m=_vec(extract[1])),
        ),
        content_hash="office",
    )


def _vec(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


# Whether the centres of columns of cells lie in the polygon of the floor: crossings of a ray.
def _is_inside(corners_m: Floats, x_m: Floats, y_m: Floats) -> NDArray[np.bool_]:
    x, y = np.meshgrid(x_m, y_m, indexing="ij")
    inside = np.zeros(x.shape, bool)
    for (ax, ay), (bx, by) in zip(corners_m, np.roll(corners_m, -1, axis=0), strict=True):
        crosses = (ay > y) != (by > y)
        inside ^= crosses & (x < (bx - ax) * (y - ay) / (by - ay if by != ay else 1.0) + ax)
    return inside


def simulate_readings(
    room: RoomSensors, environment: Environment, experiment: RoomExperiment, seconds: float
) -> Floats:
    """Return the (n, k) readings of the sensors in simulated gas, each second from the release, in arbitrary units."""
    gas = {
        "model": "filament",
        "gas": "ethanol",
        "sources": [{"position_m": _into_air(environment, experiment.source_m), "filaments_per_s": FILAMENTS_PER_S}],
        "step_s": STEP_S,
        "eddy_diffusivity_m2_s": EDDY_DIFFUSIVITY_M2_S,
    }
    field = build_gas_field(build_gas_scenario(gas, name="office", seed=experiment.number), environment)
    reading, share = np.zeros(len(room.sensors)), 1.0 - np.exp(-STEP_S / LAG_S)
    readings = []
    for _ in range(round(seconds / STEP_S)):
        field.advance(1)
        reading = reading + share * (field.mixing_ratio_ppm_at(room.positions_m)[:, 0] - reading)
        readings.append(reading)
    return np.array(readings)


# Sources on a wall or the floor are moved into the nearest cell of air.
def _into_air(environment: Environment, source_m: tuple[float, float, float]) -> tuple[float, float, float]:
    air = np.argwhere(environment.occupancy == 0)
    centres_m = (air + 0.5) * CELL_M
    near = np.clip(np.array(source_m), 0.1, None)
    cell = air[np.argmin(((centres_m - near) ** 2).sum(axis=1))]
    low_m = cell * CELL_M + 0.05
    return _vec(np.clip(near, low_m, low_m + CELL_M - 0.1))


def measure(room: RoomSensors, effort: Effort, progress: Progress) -> Findings:
    """Return onset, growth and whiffs of our readings beside those of the experiments."""
    environment = build_room(room)
    experiments = [e for e in room.experiments if e.gas_seen_s is not None]
    experiments = experiments[: _QUICK_EXPERIMENTS if effort == "quick" else None]
    found: list[_Pair] = []
    for i, experiment in enumerate(experiments):
        progress(f"experiment {experiment.number}", i / len(experiments))
        # The fifth sensor's rise is known; the release was some minutes before.
        quiet_s = float(experiment.gas_seen_s or 0.0) - 180.0
        theirs = compute_sensor_figures(experiment.time_s, experiment.readings_ppm, quiet_until_s=quiet_s)
        ours = simulate_readings(room, environment, experiment, _RUN_S)
        time_s = STEP_S * np.arange(1.0, len(ours) + 1.0)
        found.append((experiment, theirs, compute_sensor_figures(time_s, ours, quiet_until_s=0.0)))
    return Findings(figures=_figures(found), drawings={"onset": lambda figure: _draw(figure, found)})


def _figures(found: Sequence[_Pair]) -> list[Figure]:
    correlation = np.array([_onset_correlation(theirs, ours) for _, theirs, ours in found])
    growth = np.array([ours.growth_s / theirs.growth_s for _, theirs, ours in found])
    ratios = np.concatenate([_whiff_ratios(theirs, ours) for _, theirs, ours in found])
    figures = [
        Figure("onset", plain_estimate(float((correlation >= 0.5).sum()), len(found))),
        Figure("correlation", median_estimate(correlation)),
        Figure("growth", median_estimate(growth)),
        Figure("whiffs", median_estimate(ratios)),
    ]
    of_whom = {"measured": [theirs for _, theirs, _ in found], "ours": [ours for _, _, ours in found]}
    for whose, each in of_whom.items():
        liveliest = [np.sort(one.intensity[np.isfinite(one.intensity)])[-2:].mean() for one in each]
        middle = [float(np.nanmedian(one.intensity)) for one in each]
        for which, values in (("two liveliest sensors", liveliest), ("median sensor", middle)):
            figures.append(Figure("intensity", median_estimate(values), which=which, whose=whose))
    return figures


def _onset_correlation(theirs: SensorFigures, ours: SensorFigures) -> float:
    from scipy.stats import rankdata

    both = np.isfinite(theirs.onset_s) & np.isfinite(ours.onset_s)
    if both.sum() < 3:
        return np.nan
    return float(np.corrcoef(rankdata(theirs.onset_s[both]), rankdata(ours.onset_s[both]))[0, 1])


# At the sensors with the most lively readings where they were measured; without whiffs of ours the ratio is 0.
def _whiff_ratios(theirs: SensorFigures, ours: SensorFigures) -> Floats:
    strongest = np.argsort(-np.nan_to_num(theirs.intensity))[:N_STRONGEST]
    with np.errstate(divide="ignore", invalid="ignore"):
        return ours.whiffs_per_min[strongest] / theirs.whiffs_per_min[strongest]


def _draw(figure: Any, found: Sequence[_Pair]) -> None:
    n_columns = min(4, len(found))
    panels = figure.subplots(-(-len(found) // n_columns), n_columns, squeeze=False).ravel()
    for axes, (experiment, theirs, ours) in zip(panels, found, strict=False):
        axes.plot((theirs.onset_s - np.nanmin(theirs.onset_s)) / 60.0, ours.onset_s / 60.0, ".", ms=4)
        r = _onset_correlation(theirs, ours)
        axes.set_title(f"experiment {experiment.number}: {r:.2f}")
    figure.supxlabel("measured onset since the first sensor's [min]", fontsize=8)
    figure.supylabel("ours since the release [min]", fontsize=8)
