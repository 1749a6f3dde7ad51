"""docs/extend/gas_model.md and wind_solver.md: every step is carried out, on a copy."""

import json
from pathlib import Path

import pytest
import yaml

EXTEND = Path(__file__).parents[2] / "docs" / "extend"
PAGES = {"gas": (EXTEND / "gas_model.md").read_text(), "wind": (EXTEND / "wind_solver.md").read_text()}
SHORT = ["--set", "referee.stop.time_limit_s=5", "--set", "recording.enabled=false"]


@pytest.fixture(scope="module")
def packages(lay_out_package, tmp_path_factory):
    return {name: lay_out_package(page, tmp_path_factory.mktemp(name)) for name, page in PAGES.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "resolved"),
    [("gas", {"model": "mixed", "air_changes_per_s": 0.01}), ("wind", {"solver": "swirl", "turn_rad_s": 0.2})],
)
def test_what_a_package_brings_runs_with_its_settings(packages, gslcosim_with, tmp_path, part, resolved, find_words):
    words = find_words(PAGES[part])
    done = gslcosim_with(packages[part], [*words, *SHORT], tmp_path)
    assert done.returncode in (0, 1, 4), done.stdout + done.stderr
    (file,) = tmp_path.glob("runs/*/scenario.yaml")
    assert resolved.items() <= yaml.safe_load(file.read_text())[part].items()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "kind", "name", "setting"),
    [("gas", "gas_models", "mixed", "air_changes_per_s"), ("wind", "wind_solvers", "swirl", "turn_rad_s")],
)
def test_it_is_listed_with_its_settings(packages, gslcosim_with, tmp_path, part, kind, name, setting):
    rows = json.loads(gslcosim_with(packages[part], ["list", kind, "--json"], tmp_path).stdout)[kind]
    (row,) = [row for row in rows if row["name"] == name]
    (listed,) = [each for each in row["settings"] if each["key"] == setting]
    assert listed["meaning"]
    assert listed["default"] in ("0.001", "0.1")
