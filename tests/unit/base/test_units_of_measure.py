"""Units of measure at the ends of names, in files, and behind numbers."""

import pytest

from gslcosim.base.units_of_measure import (
    number_in_unit_of,
    read_quantity,
    unit_name,
    unit_suffix,
)


@pytest.mark.parametrize(
    ("key", "ending", "unit"),
    [
        ("hold_s", "_s", "seconds"), ("start_m", "_m", "metres"), ("max_speed_m_s", "_m_s", "metres per second"),
        ("max_acceleration_m_s2", "_m_s2", "metres per second squared"), ("tick_ms", "_ms", "milliseconds"),
        ("eddy_diffusivity_m2_s", "_m2_s", "square metres per second"), ("filaments_per_s", "_per_s", "per second"),
        ("direction_noise_std_rad", "_rad", "radians"), ("ppm", "_ppm", "ppm"), ("seed", "", ""), ("name", "", ""),
        ("flow_m3_s", "_m3_s", "cubic metres per second"), ("power_w", "_w", "watts"),
    ],
)  # fmt: skip
def test_a_key_says_its_unit(key, ending, unit):
    assert (unit_suffix(key), unit_name(key)) == (ending, unit)


@pytest.mark.parametrize(
    ("text", "key", "number"),
    [
        ("2 m", "start_m", 2.0), ("2m", "start_m", 2.0), ("20 cm", "cell_m", 0.2), ("0.5 km", "start_m", 500.0),
        ("500 ms", "hold_s", 0.5), ("2 min", "hold_s", 120.0), ("0.1 s", "tick_ms", 100.0),
        ("100 ms", "tick_ms", 100.0),
        ("3.6 km/h", "max_speed_m_s", 1.0), ("180 deg", "noise_rad", 3.14159), ("5 ppb", "ppm", 0.005),
        ("1e-3 m2/s", "growth_m2_s", 0.001), ("10 Hz", "filaments_per_s", 10.0), ("7", "hold_s", 7.0),
    ],
)  # fmt: skip
def test_a_written_unit_is_converted_to_that_of_the_key(text, key, number):
    quantity = read_quantity(text)
    assert quantity is not None
    assert number_in_unit_of(key, quantity) == pytest.approx(number)


@pytest.mark.parametrize(("text", "key"), [("2 m", "hold_s"), ("2 furlongs", "start_m"), ("2 m", "seed")])
def test_a_unit_of_another_kind_is_not_converted(text, key):
    quantity = read_quantity(text)
    assert quantity is not None
    assert number_in_unit_of(key, quantity) is None


@pytest.mark.parametrize("text", ["", "high", "m 2", "1 2", "2 m 3 cm", "--3"])
def test_what_is_not_a_number_with_a_unit_is_no_quantity(text):
    assert read_quantity(text) is None
