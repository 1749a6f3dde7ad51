import math

import briefings
import numpy as np
import pytest

from gslcosim_search.beliefs import CellGrid
from gslcosim_search.maps.kernel_dm import GasMaps, KernelMap, KernelWidths, ReadingCollector, choose_next_cell
from gslcosim_search.senses.instruments import Nose, Vane

PLANE = CellGrid((1.0, -2.0), 0.25, (16, 12))
SPACE = CellGrid((1.0, -2.0, 0.5), 0.25, (9, 8, 6))
NOSE = Nose(name="nose", unit="ppm", mount_body_m=(0.0, 0.0, 0.0))
VANE = Vane(name="vane")


def readings(n: int = 12, seed: int = 1) -> list[tuple]:
    """Rows of place, value, time and wind."""
    draws = np.random.default_rng(seed)
    places = draws.uniform((1.0, -2.0, 0.5), (5.0, 1.0, 2.0), (n, 3))
    return [
        (tuple(place), float(value), float(i), tuple(wind))
        for i, (place, value, wind) in enumerate(zip(places, draws.exponential(size=n), draws.normal(size=(n, 2))))
    ]


def mapped(rows: list[tuple], grid: CellGrid = PLANE, **widths) -> GasMaps:
    gas = KernelMap(grid, KernelWidths(**widths))
    for place_m, value, time_s, wind_m_s in rows:
        gas.add(place_m, value, time_s=time_s, wind_m_s=wind_m_s)
    return gas.maps()


def by_definition(rows: list[tuple], grid: CellGrid, widths: KernelWidths) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, variance and confidence, cell by cell and reading by reading."""

    def weight(centre, row):
        place_m, _, time_s, wind = row
        speed = math.hypot(*wind)
        u = (wind[0] / speed, wind[1] / speed)
        a = widths.sigma_m + widths.stretch_s * speed
        b = widths.sigma_m * (widths.sigma_m / a) ** (1.0 / (grid.dimensions - 1))
        offset = np.subtract(centre, place_m[: grid.dimensions])
        p = offset[0] * u[0] + offset[1] * u[1]
        q_squared = float(offset @ offset) - p * p
        age_s = rows[-1][2] - time_s
        return math.exp(-0.5 * (p * p / a**2 + q_squared / b**2) - widths.decay_per_s * age_s)

    def blended(values):
        result = np.zeros(grid.n_cells)
        confidence = np.zeros(grid.n_cells)
        for k, centre in enumerate(grid.centres_m()):
            weights = np.array([weight(centre, row) for row in rows])
            confidence[k] = 1.0 - math.exp(-((weights.sum() / widths.confidence_scale) ** 2))
            local = float(weights @ values) / weights.sum()
            result[k] = confidence[k] * local + (1.0 - confidence[k]) * np.mean(values)
        return result.reshape(grid.shape), confidence.reshape(grid.shape)

    values = np.array([row[1] for row in rows])
    mean, confidence = blended(values)
    squares = np.array([(row[1] - mean[grid.nearest_cell(row[0])]) ** 2 for row in rows])
    return mean, blended(squares)[0], confidence


@pytest.mark.parametrize("grid", [PLANE, SPACE], ids=["plane", "space"])
@pytest.mark.parametrize(
    "widths",
    [
        KernelWidths(sigma_m=0.6),
        KernelWidths(sigma_m=0.6, stretch_s=0.33, confidence_scale=2.0),
        KernelWidths(sigma_m=0.6, decay_per_s=0.1),
    ],
    ids=["round", "wind", "decay"],
)
def test_the_maps_are_those_of_the_definition(grid, widths):
    rows = readings()
    maps = mapped(rows, grid, **vars(widths))
    mean, variance, confidence = by_definition(rows, grid, widths)
    assert maps.mean == pytest.approx(mean, rel=1e-7)
    assert maps.variance == pytest.approx(variance, rel=1e-7)
    assert maps.confidence == pytest.approx(confidence, abs=1e-9)


def test_the_oldest_readings_are_dropped_where_there_are_too_many():
    gas = KernelMap(PLANE, max_readings=5)
    for place_m, value, time_s, _ in readings(12):
        gas.add(place_m, value, time_s=time_s)
    rows = [(place_m, value, time_s, (0.0, 0.0)) for place_m, value, time_s, _ in readings(12)]
    assert gas.n_readings == 5
    assert gas.maps().mean == pytest.approx(mapped(rows[-5:]).mean)


def test_the_peak_is_where_the_gas_varies_among_known_places():
    rows = [((2.0, 0.0), value, 0.0, (0.0, 0.0)) for value in (0.0, 8.0, 0.0, 8.0)]
    rows += [((4.5, -1.5), 1.0, 0.0, (0.0, 0.0))] * 4
    peak = mapped(rows).peak()
    assert peak is not None
    assert math.dist(PLANE.centre_m(peak), (2.0, 0.0)) < 0.3


def test_broken_readings_are_ignored_and_without_a_reading_the_maps_are_empty():
    gas = KernelMap(PLANE)
    gas.add((2.0, 0.0), math.inf)
    gas.add((2.0, 0.0), math.nan)
    assert gas.n_readings == 0
    assert not gas.maps().mean.any()
    assert gas.maps().peak() is None


def observation(tick: int, *, x_m: float = 0.0, ppm: float = 1.0, speed_m_s: float = 0.0, warms_up: bool = False):
    return briefings.observation(
        tick=tick, position_m=(x_m, 0.0, 2.0), velocity_m_s=(speed_m_s, 0.0, 0.0), asked=False, status="flying",
        readings={"nose": ppm, "vane": (0.5, 0.0)}, warming=["nose"] if warms_up else (),
    )  # fmt: skip


def test_readings_are_taken_every_so_often_and_put_where_the_vehicle_was_a_lag_before():
    on_the_way = ReadingCollector(NOSE, every_s=1.0, lag_s=0.5)
    readings = [on_the_way.add(observation(tick, x_m=0.1 * tick, ppm=float(tick))) for tick in range(31)]
    taken = [reading for reading in readings if reading is not None]
    assert [reading.value for reading in taken] == [0.0, 10.0, 20.0, 30.0]
    assert [reading.place_m[0] for reading in taken] == pytest.approx([0.0, 0.5, 1.5, 2.5])
    assert [reading.time_s for reading in taken] == [0.0, 1.0, 2.0, 3.0]


def test_the_wind_is_that_of_the_air_while_the_vehicle_flies_with_it():
    """The anemometer feels 0.5 m/s from the east, the vehicle flies west at 0.7 m/s: the air goes west at 1.2 m/s."""
    on_the_way = ReadingCollector(NOSE, VANE, every_s=1.0, lag_s=0.0)
    reading = on_the_way.add(observation(0, speed_m_s=-0.7))
    assert reading is not None
    assert reading.wind_m_s == pytest.approx((-1.2, 0.0))


def test_a_sensor_that_warms_up_gives_no_reading_and_a_tick_counts_once():
    on_the_way = ReadingCollector(NOSE, every_s=0.0, lag_s=0.0)
    assert on_the_way.add(observation(0, warms_up=True)) is None
    assert on_the_way.add(observation(1)) is not None
    assert on_the_way.add(observation(1)) is None


def maps(mean, confidence) -> GasMaps:
    mean, confidence = np.array(mean, float), np.array(confidence, float)
    return GasMaps(mean=mean, variance=np.zeros_like(mean), confidence=confidence)


def test_gas_draws_and_so_does_what_is_unknown():
    everywhere, near = np.ones((3, 1), bool), np.zeros((3, 1))
    known = maps([[0.0], [2.0], [1.0]], [[1.0], [1.0], [0.0]])
    assert choose_next_cell(known, everywhere, near, curiosity=0.4, travel_per_m=0.0) == (1, 0)
    assert choose_next_cell(known, everywhere, near, curiosity=0.6, travel_per_m=0.0) == (2, 0)


def test_of_equal_places_the_nearest_that_can_be_flown_to_is_chosen():
    flyable = np.array([[True], [True], [False], [True]])
    lengths_m = np.array([[5.0], [3.0], [1.0], [np.inf]])
    empty = maps(np.zeros((4, 1)), np.zeros((4, 1)))
    assert choose_next_cell(empty, flyable, lengths_m, curiosity=1.0, travel_per_m=0.1) == (1, 0)
    assert choose_next_cell(empty, flyable, np.full((4, 1), np.inf), curiosity=1.0, travel_per_m=0.1) is None
