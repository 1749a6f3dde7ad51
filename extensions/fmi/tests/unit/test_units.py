"""Units of an FMU's variables beside those at the ends of names."""

import pytest

from gslcosim_fmi.units import UnitOfMeasure, unit_symbol


@pytest.mark.parametrize(
    ("key", "symbol"),
    [("wind_world_m_s", "m/s"), ("mixing_ratio_ppm", "ppm"), ("share", "1"), ("charge", ""), ("a", ""), ("is_on", "")],
)
def test_a_key_has_the_usual_symbol_of_its_unit(key, symbol):
    assert unit_symbol(key) == symbol


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
