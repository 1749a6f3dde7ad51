"""Units of measure at the ends of names, beside those of files."""

import pytest

from gslcosim.base.measures import UnitOfMeasure, find_measure_suffix, name_measure


@pytest.mark.parametrize(
    ("name", "suffix", "usual"),
    [
        ("wind_world_m_s", "_m_s", "m/s"),
        ("position_world_m", "_m", "m"),
        ("mixing_ratio_ppm", "_ppm", "ppm"),
        ("ppm", "_ppm", "ppm"),
        ("time_s", "_s", "s"),
        ("share", "_share", "1"),
    ],
)
def test_the_end_of_a_name_says_its_unit(name, suffix, usual):
    assert find_measure_suffix(name) == suffix
    assert name_measure(suffix) == usual


def test_a_name_without_a_unit_has_none():
    assert [find_measure_suffix(name) for name in ("charge", "values", "is_on", "ms")] == [None] * 4


@pytest.mark.parametrize(
    ("suffix", "unit", "is_equal"),
    [
        ("_m_s", UnitOfMeasure(name="m/s"), True),
        ("_m_s", UnitOfMeasure(name="meter / second", exponents={"m": 1, "s": -1}), True),
        ("_m_s", UnitOfMeasure(name="km/h", exponents={"m": 1, "s": -1}, factor=1 / 3.6), False),
        ("_m_s", UnitOfMeasure(name="knots"), False),
        ("_k", UnitOfMeasure(name="degC", exponents={"K": 1}, offset=273.15), False),
        ("_rad", UnitOfMeasure(name="radian", exponents={}), True),
        ("_ppm", UnitOfMeasure(name="share", exponents={}, factor=1e-6), True),
        ("_ppm", UnitOfMeasure(name="1", exponents={}), False),
    ],
)
def test_units_are_equal_by_name_or_by_exponents_factor_and_offset(suffix, unit, is_equal):
    assert unit.is_that_of(suffix) is is_equal
