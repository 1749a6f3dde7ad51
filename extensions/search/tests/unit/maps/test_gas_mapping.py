import briefings
import numpy as np
import pytest

from gslcosim_search.maps.kernel_dm import GasMaps, ReadingCollector, choose_next_cell
from gslcosim_search.senses.instruments import Nose, Vane

NOSE = Nose(name="nose", unit="ppm", mount_body_m=(0.0, 0.0, 0.0))
VANE = Vane(name="vane")


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
