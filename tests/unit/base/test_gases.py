from dataclasses import asdict

import pytest

from gslcosim.base.gases import GASES, Gas, air_density_mol_m3
from gslcosim.cli.main import main
from gslcosim.scenario.loader import load_scenario
from gslcosim_services.sensing.models.mox import build_mox_parameters


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


def test_every_figure_of_a_gas_has_a_source():
    for gas in GASES.values():
        figures = {key for key, value in asdict(gas).items() if value and value == value} - {"sources", "gaden_code"}
        assert figures == set(gas.sources)


def test_one_entry_adds_a_gas_to_scenarios_sensors_and_lists(monkeypatch, capsys):
    xenon = Gas(specific_gravity=4.5, mox={"tgs2600": (0.5, -0.3)}, sources={"specific_gravity": "", "mox": ""})
    monkeypatch.setitem(GASES, "xenon", xenon)
    loaded = load_scenario("tiny_room", overrides=["gas.gas=xenon"])
    assert loaded.scenario.gas.gas == "xenon"
    assert build_mox_parameters()["tgs2600"].power_law["xenon"] == (0.5, -0.3)
    assert main(["list", "gases"]) == 0
    assert "xenon" in capsys.readouterr().out
