from gslcosim.base.quantities import GAS_QUANTITIES, POINT_GAS_QUANTITIES
from gslcosim.methods.card import WIND_QUANTITY
from gslcosim_services.sensing import SENSOR_MODELS


def test_each_sensor_that_is_given_the_air_and_does_not_report_the_wind_is_a_gas_sensor():
    """One table says so to validity, scores, the keyboard and methods; a laser was none for two of them."""
    given_air = {kind.quantity for kind in SENSOR_MODELS.values() if not kind.is_on_board}
    assert given_air - {WIND_QUANTITY} == set(GAS_QUANTITIES)
    assert set(GAS_QUANTITIES) - set(POINT_GAS_QUANTITIES) == {SENSOR_MODELS["tdlas"].quantity}
