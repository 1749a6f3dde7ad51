"""Each kind's settings come from its block, with key, unit, default and meaning."""

import pytest

from gslcosim.scenario.model_schema import SettingRow, list_settings
from gslcosim.scenario.models.gas import GAS_MODELS
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS
from gslcosim.scenario.models.wind import WIND_SOLVERS

BLOCKS = {**SENSOR_BLOCKS, **GAS_MODELS, **WIND_SOLVERS}


def keys(kind):
    return {each.key for each in list_settings(BLOCKS[kind], kind=kind)}


@pytest.mark.parametrize("kind", BLOCKS)
def test_every_setting_has_a_meaning(kind):
    assert [each.key for each in list_settings(BLOCKS[kind], kind=kind) if each.meaning.partition("(")[0] == ""] == []


def test_unit_and_default_are_those_of_the_block():
    settings = list_settings(GAS_MODELS["filament"], kind="filament")
    meaning = "integral length, about that of the largest eddies"
    assert SettingRow(key="turbulence.length_m", unit="metres", default="2", meaning=meaning) in settings


def test_settings_of_other_kinds_with_the_same_block_are_left_out():
    assert {"courant", "inlet_schedule.shares"} <= keys("built_in") - keys("uniform")
    assert "loops" in keys("file") - keys("openfoam")
