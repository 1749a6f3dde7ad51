"""Leaks in an office: onset, growth and whiffs at sensors, in our wind and filaments (Örebro)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import Cell, Environment, Grid, Opening, WindFrames
from gslcosim.environment.openings import cells_at
from gslcosim.flow import WindReport
from gslcosim.flow.buoyancy import BuoyantScalar, Release, Surface
from gslcosim.flow.patches import Inlet, Outlet
from gslcosim.flow.solve import solve_wind_report
from gslcosim_formats.heat.sources import AIR_HEAT_J_M3_K, build_surface
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_validation.gas_models import build_gas_scenario
from gslcosim_validation.readers.room_sensors import RoomExperiment, RoomSensors
from gslcosim_validation.release_pairs import build_pairs
from gslcosim_validation.results import Effort, Figure, Findings, Progress, median_estimate, plain_estimate

Floats = NDArray[np.float64]

CELL_M = 0.25
STEP_S = 2.0
# A displacement supply: a guess within what the set's description allows; 180 m3/h, 1.9 changes of air an hour.
SUPPLY_M_S = 0.2
SUPPLY_SIZE_M = 0.5
# Heater and electronics of one metal-oxide sensor: 0.3 to 1 W in data sheets; chosen.
SENSOR_W = 0.5
# The warm part of the window's wall reaches from the floor to the sill, and this far to the sides of the window, as
# radiators below windows do; chosen.
WARM_BESIDE_M = 0.5
# Heat of the first of two solves; from its spread of temperature follows that of the second.
FIRST_W = 300.0
# Time of a solve, and the start of its mean: natural convection turns this room over in about 50 s.
SOLVE_S, MEAN_FROM_S = 500.0, 250.0
FILAMENTS_PER_S = 1.0
SIGMA_M = 0.1
# First-order lag of a MOX sensor in its cage, "of seconds".
LAG_S = 5.0
# Sensors are not comparable with each other, so a sensor has seen gas at this share of its own high readings.
ONSET_SHARE, ONSET_NOISES, SMOOTH_S = 0.05, 5.0, 10.0
ONSET_WITHIN_S = 2400.0
# When whiffs are counted, and over which trends are taken away [s since gas was first seen].
LIVELY_S, TREND_S = (1800.0, 4800.0), 300.0
WHIFF_SHARE = 0.5
N_STRONGEST = 5
# Within which intensities are to be.
INTENSITY_FACTOR = 1.5
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
    """Return the room on cells of 0.25 m with its wind, k and epsilon.

    Air enters low at x = 0 beside the supply, and leaves above. The wall below the window is warm, the other walls are
    as warm as the air that enters; the heat makes the air as different in temperature as the nodes on the desks are.
    """
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
    openings = (
        Opening(name="supply", kind="inlet", min_m=supply[0], max_m=supply[1], velocity_m_s=(SUPPLY_M_S, 0.0, 0.0)),
        Opening(name="extract", kind="outlet", min_m=_vec(extract[0]), max_m=_vec(extract[1])),
    )
    wind = _solve_warm_wind(room, grid, free, openings)
    occupancy = np.where(free, Cell.FREE, Cell.SOLID).astype(np.uint8)
    occupancy[cells_at(openings[1], grid)] = Cell.OUTLET
    assert wind.k_m2_s2 is not None
    assert wind.epsilon_m2_s3 is not None
    k_epsilon = np.stack([wind.k_m2_s2, wind.epsilon_m2_s3], axis=-1) * free[..., None]
    return Environment(
        name="office",
        grid=grid,
        occupancy=occupancy,
        wind=WindFrames(velocity_m_s=wind.velocity_m_s[None], k_epsilon=k_epsilon.astype(np.float32)),
        boxes=(),
        openings=openings,
        content_hash="office",
    )


def measure_temperature_spread_k(room: RoomSensors) -> float:
    """Return the standard deviation between the nodes' temperatures, median of time and of experiments [K]; 0 without.

    Of the gas nothing is used.
    """
    spreads_k = [np.nanmedian(each.temperature_c.std(axis=1, ddof=1)) for each in room.experiments if _has_nodes(each)]
    return float(np.median(spreads_k)) if spreads_k else 0.0


def _has_nodes(experiment: RoomExperiment) -> bool:
    return experiment.temperature_c.shape[1] > 1


# The spread grows as the power's 2/3, as the buoyancy of plumes and of layers does (Morton, Taylor and Turner 1956).
def _solve_warm_wind(
    room: RoomSensors, grid: Grid, free: NDArray[np.bool_], openings: tuple[Opening, Opening]
) -> WindReport:
    wanted_k = measure_temperature_spread_k(room)
    if room.window_m is None or wanted_k == 0.0:
        return _solve_wind(free, openings, None)
    first = _solve_wind(free, openings, _build_heat(room, grid, FIRST_W))
    assert first.scalar is not None
    power_w = FIRST_W * (wanted_k / float(first.scalar[free].std())) ** 1.5
    return _solve_wind(free, openings, _build_heat(room, grid, power_w))


def _solve_wind(free: NDArray[np.bool_], openings: tuple[Opening, Opening], heat: BuoyantScalar | None) -> WindReport:
    supply, extract = openings
    patches = [
        Inlet(min_m=supply.min_m, max_m=supply.max_m, velocity_m_s=supply.velocity_m_s),
        Outlet(min_m=extract.min_m, max_m=extract.max_m),
    ]
    return solve_wind_report(free, CELL_M, patches, buoyancy=heat, end_time_s=SOLVE_S, average_from_s=MEAN_FROM_S)


def _build_heat(room: RoomSensors, grid: Grid, power_w: float) -> BuoyantScalar:
    assert room.window_m is not None
    (_, low_y_m, sill_m), (_, high_y_m, _) = room.window_m
    x_m, y_m, z_m = grid.max_m
    warm = build_surface((x_m, low_y_m - WARM_BESIDE_M, 0.0), (x_m, high_y_m + WARM_BESIDE_M, sill_m), power_w=power_w)
    ceiling, south, west = (
        build_surface(low_m, high_m, excess_k=0.0)
        for low_m, high_m in (
            ((0.0, 0.0, z_m), (x_m, y_m, z_m)),
            ((0.0, 0.0, 0.0), (x_m, 0.0, z_m)),
            ((0.0, 0.0, 0.0), (0.0, y_m, z_m)),
        )
    )
    surfaces: list[Surface] = [warm, ceiling, south, west]
    sensors = [
        Release(position_m=_vec(place_m), scalar_m3_s=SENSOR_W / AIR_HEAT_J_M3_K) for place_m in room.positions_m
    ]
    return BuoyantScalar.of_heat(surfaces=surfaces, releases=sensors)


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
    """Return the (n, k) readings of the sensors in simulated gas, each step from the release, in arbitrary units."""
    gas = {
        "model": "filament",
        "gas": "ethanol",
        "sources": [
            {
                "position_m": _into_air(environment, experiment.source_m),
                "filaments_per_s": FILAMENTS_PER_S,
                "sigma_m": SIGMA_M,
            }
        ],
        "step_s": STEP_S,
        # Gas within filaments that are minutes old is mixed. A run with an inner fluctuation that fades as they grow is
        # still to be made.
        "turbulence": {"kind": "wind", "inner_intensity": 0.0},
        "wall_images": True,
        # A few tens of ppm are no heavier than air a hundredth of a kelvin colder.
        "buoyancy": "none",
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
    pairs = [
        each
        for experiment, theirs, ours in found
        for each in build_pairs(
            "room_with_heat", f"experiment {experiment.number}", "intensity", ours.intensity, theirs.intensity
        )
    ]
    return Findings(figures=_figures(found), drawings={"onset": lambda figure: _draw(figure, found)}, pairs=pairs)


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
    for which, find in (("two liveliest sensors", _find_liveliest), ("median sensor", _find_middle)):
        measured = median_estimate([find(theirs) for _, theirs, _ in found])
        ours = median_estimate([find(ours) for _, _, ours in found])
        bounds = {"low": measured.value / INTENSITY_FACTOR, "high": measured.value * INTENSITY_FACTOR}
        figures.append(Figure("intensity", measured, "measured", which=which, whose="measured", **bounds))
        figures.append(Figure("intensity", ours, "ours", which=which, whose="ours", **bounds))
    return figures


def _find_liveliest(figures: SensorFigures) -> float:
    return float(np.sort(figures.intensity[np.isfinite(figures.intensity)])[-2:].mean())


def _find_middle(figures: SensorFigures) -> float:
    return float(np.nanmedian(figures.intensity))


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
