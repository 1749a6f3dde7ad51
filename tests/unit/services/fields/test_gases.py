import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim_services.fields.gases import GASES, air_density_mol_m3, find_gas


def test_air_holds_gadens_amount_at_298_k_and_1_atm():
    assert air_density_mol_m3() == pytest.approx(40.894632701667424, rel=1e-14)


def test_air_density_falls_with_temperature_and_rises_with_pressure():
    assert air_density_mol_m3(596.0) == pytest.approx(air_density_mol_m3() / 2)
    assert air_density_mol_m3(pressure_pa=2 * 101325.0) == pytest.approx(air_density_mol_m3() * 2)


def test_gases_have_gadens_codes_and_specific_gravities():
    assert [gas.gaden_code for gas in GASES.values()] == list(range(14))
    assert [GASES[name].specific_gravity for name in ("ethanol", "methane", "hydrogen", "acetone", "butane")] == [
        1.0378, 0.5537, 0.0696, 1.4529, 2.0061,
    ]  # fmt: skip


def test_an_unknown_gas_is_answered_with_the_known_ones():
    with pytest.raises(ScenarioError, match=r"gas\.gas: expected one of ethanol, .*smoke, was 'etanol'"):
        find_gas("etanol")
