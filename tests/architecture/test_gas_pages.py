"""The pages on gas and sensors say what the code does: tables are current, and their pieces of scenarios are valid."""

import re
from pathlib import Path

import pytest
import yaml

from gslcosim.scenario.gas_models import GasSpec
from gslcosim.scenario.loading import load_scenario
from gslcosim.scenario.sensor_models import SENSORS, SensorSpec
from gslcosim.sensing.reference import with_tables

ROOT = Path(__file__).parents[2]
GAS, SENSORS_PAGE = ROOT / "docs" / "gas.md", ROOT / "docs" / "sensors.md"
PIECES = [
    (page.name, text)
    for page in (GAS, SENSORS_PAGE)
    for text in re.findall(r"```yaml\n(.*?)```", page.read_text(), re.DOTALL)
]


def test_the_tables_of_sensors_are_current():
    page = SENSORS_PAGE.read_text()
    assert page.count("<!-- table ") == 3
    assert page == with_tables(page), "`make docs` rewrites them"


def test_every_sensor_and_every_setting_of_sensors_is_on_the_page():
    page = SENSORS_PAGE.read_text()
    assert [name for name in SENSORS if f"| `{name}` |" not in page] == []
    settings = set(SensorSpec.model_fields) - {"model", "name"}
    assert [name for name in settings if f"`{name}`" not in page] == []


def test_every_model_and_every_setting_of_gas_is_on_the_page():
    page = GAS.read_text()
    models = ("filament", "gaussian_plume", "meandering_plume", "farrell", "playback")
    assert [name for name in models if f"| `{name}` |" not in page] == []
    hidden = {"define", "gaden_noise_std_m"}
    assert [name for name in set(GasSpec.model_fields) - hidden if name not in page] == []


@pytest.mark.parametrize(("page", "piece"), PIECES, ids=lambda value: value[:30].replace("\n", " "))
def test_pieces_of_scenarios_are_valid(page, piece, tmp_path):
    values = yaml.safe_load((ROOT / "scenarios" / "tiny_room.yaml").read_text())
    values |= yaml.safe_load(piece)
    folder = values["gas"].get("playback", {}).get("folder")
    if folder:
        (tmp_path / folder).mkdir(parents=True)
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump(values))
    assert load_scenario(path).scenario.gas.sources
