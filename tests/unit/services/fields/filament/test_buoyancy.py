import math

import pytest

from gslcosim.base.gases import GASES
from gslcosim.base.quantities import GRAVITY_M_S2
from gslcosim_services.fields.filament.plume import NEUTRAL, gaden_3_buoyancy, terminal_velocity_buoyancy

VOLUME_M3 = 10e-6 * (2 * math.pi) ** 1.5 * 0.1**3


def test_weight_and_drag_are_in_balance():
    """g |1 - SG| V = Cd / 2 pi (2 sigma)^2 w^2, per density of air."""
    for gas in GASES.values():
        w = terminal_velocity_buoyancy(gas.specific_gravity, VOLUME_M3).velocity_m_s(0.3)
        drag = 0.5 * 0.5 * math.pi * 0.6**2 * w**2
        assert drag == pytest.approx(GRAVITY_M_S2 * abs(1 - gas.specific_gravity) * VOLUME_M3)
        assert (w > 0) == (gas.specific_gravity < 1)


def test_a_filament_slows_down_as_it_grows():
    methane = terminal_velocity_buoyancy(GASES["methane"].specific_gravity, VOLUME_M3)
    assert methane.velocity_m_s(0.1) == pytest.approx(0.0047, rel=0.01)
    assert methane.velocity_m_s(0.2) == pytest.approx(methane.velocity_m_s(0.1) / 2)


def test_gas_as_heavy_as_air_stays():
    assert terminal_velocity_buoyancy(1.0, VOLUME_M3).velocity_m_s(0.1) == 0.0
    assert NEUTRAL.velocity_m_s(0.1) == 0.0


@pytest.mark.parametrize(
    ("gas", "velocity_m_s"), [("ethanol", -0.0131), ("methane", 0.1541), ("hydrogen", 0.3213), ("acetone", -0.1564)]
)
def test_gaden_3s_figures_at_10_ppm(gas, velocity_m_s):
    buoyancy = gaden_3_buoyancy(GASES[gas].specific_gravity, 10.0, 0.1)
    assert buoyancy.velocity_m_s(0.1) == pytest.approx(velocity_m_s, abs=6e-5)
    assert buoyancy.velocity_m_s(0.2) == pytest.approx(velocity_m_s / 8, abs=1e-5)
