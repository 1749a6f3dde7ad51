"""The pages on gas and sensors say what the code does: tables are current, and their pieces of scenarios are valid."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from sensors_page import fill_tables

from gslcosim.cli.main import main
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.model_schema import list_settings
from gslcosim.scenario.models.gas import GAS_MODELS
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, SENSORS

ROOT = Path(__file__).parents[2]
GAS, SENSORS_PAGE = ROOT / "docs" / "gas.md", ROOT / "docs" / "sensors.md"
REFERENCE = Path(os.environ.get("GSLCOSIM_REFERENCE", ROOT.parent / "shared" / "reference"))
GSL_BENCH = REFERENCE / "gsl-bench" / "environments" / "001" / "gas_data" / "wh_empty_001"
FAILED_THE_TASK = 1
PIECES = [
    (page.name, text)
    for page in (GAS, SENSORS_PAGE)
    for text in re.findall(r"```yaml\n(.*?)```", page.read_text(), re.DOTALL)
]


def test_the_tables_of_sensors_are_current():
    page = SENSORS_PAGE.read_text()
    assert page.count("<!-- table ") == 4
    assert page == fill_tables(page), "`make docs` rewrites them"


def test_every_sensor_and_every_setting_of_sensors_is_on_the_page():
    page = SENSORS_PAGE.read_text()
    assert [name for name in SENSORS if f"| `{name}` |" not in page] == []
    settings = {each.key for name, block in SENSOR_BLOCKS.items() for each in list_settings(block, kind=name)} - {
        "model"
    }
    assert [name for name in settings if f"`{name}`" not in page] == []


def test_every_model_and_every_setting_of_gas_is_on_the_page():
    page = GAS.read_text()
    assert [name for name in GAS_MODELS if f"| `{name}` |" not in page] == []
    settings = {key for block in GAS_MODELS.values() for key in block.model_fields}
    hidden = {"define", "gaden_noise_std_m"}
    assert [name for name in settings - hidden if name not in page] == []


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


# What the pages name beside what their pieces show.
VARIANTS = [
    ("more", f"gas: {{{gas}, sources: [{{position_m: [1.5, 2, 1]}}], warm_up_s: 20}}")
    for gas in ("model: gaussian_plume", "compatibility: gaden_3", "rotor_downwash: true", "buoyancy: none")
]


@pytest.mark.slow
@pytest.mark.parametrize(("page", "piece"), PIECES + VARIANTS, ids=lambda value: value[:30].replace("\n", " "))
def test_pieces_of_scenarios_run_and_have_gas(page, piece, tmp_path, monkeypatch):
    """As a reader would try them: put into a small room, flown, and sampled."""
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path / "cache"))
    values = yaml.safe_load((ROOT / "scenarios" / "tiny_room.yaml").read_text())
    values |= yaml.safe_load(piece)
    values["referee"]["stop"]["time_limit_s"] = 3
    folder = values["gas"].get("playback", {}).get("folder")
    if folder:
        if not GSL_BENCH.is_dir():
            pytest.skip(f"no GSL-Bench data under {REFERENCE} (set GSLCOSIM_REFERENCE)")
        (tmp_path / folder).parent.mkdir(parents=True)
        (tmp_path / folder).symlink_to(GSL_BENCH)
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump(values))
    assert main(["up", str(path), "--in-process", "--runs-dir", str(tmp_path / "runs")]) == FAILED_THE_TASK
    (run,) = (tmp_path / "runs").iterdir()
    assert json.loads((run / "result.json").read_text())["valid"]
    out = tmp_path / "gas.npz"
    assert main(["environment", "sample", str(run), "--time", "3", "--grid", "0.25", "--out", str(out)]) == 0
    assert np.load(out)["mixing_ratio_ppm"].max() > 0.01
