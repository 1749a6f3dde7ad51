"""The published rooms of GSL-Bench: imported with their counts, given a wind, and flown in."""

import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from gslcosim.cli.main import main
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.model import Cell
from gslcosim.scenario.models.scenario import EnvironmentSpec, WindSpec

REFERENCE_DIR = Path(os.environ.get("GSLCOSIM_REFERENCE", Path(__file__).parents[5] / "shared" / "reference"))
ROOMS = REFERENCE_DIR / "gsl-bench" / "environments"
needs_reference = pytest.mark.skipif(
    not ROOMS.is_dir(), reason=f"GSLCOSIM_REFERENCE: no GSL-Bench environments in {REFERENCE_DIR}"
)

# Free, solid and outlet cells, counted in the published arrays.
COUNTS = {"001": (218936, 17859, 365), "003": (203238, 33557, 365), "005": (191563, 45232, 365)}
SCENARIO = {
    "schema": "gslcosim/scenario/1",
    "name": "published",
    "wind": {"end_time_s": 1},
    "gas": {"sources": [{"position_m": [5, 1, 2]}], "warm_up_s": 2},
    "agents": [
        {
            "name": "beetle",
            "start": {"python": "dung_beetle"},
            "vehicle": {"model": "crazyflie", "start_m": [12, 12, 0.2], "hold_s": 0.5},
            "sensors": [{"model": "tgs2600", "name": "nose"}, {"model": "anemometer", "name": "wind"}],
        }
    ],
    "referee": {"stop": {"time_limit_s": 6}},
}


@needs_reference
@pytest.mark.parametrize("number", COUNTS)
def test_counts_of_cells_are_those_published(number):
    room = build_geometry(EnvironmentSpec(gsl_bench=str(ROOMS / number)), WindSpec())
    assert tuple(int((room.occupancy == cell).sum()) for cell in (Cell.FREE, Cell.SOLID, Cell.OUTLET)) == COUNTS[number]


@needs_reference
@pytest.mark.slow
@pytest.mark.parametrize("number", COUNTS)
def test_a_run_uses_the_room_with_wind_solved_for_it(number, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GSLCOSIM_CACHE", os.environ.get("GSLCOSIM_CACHE", str(Path("~/.cache/gslcosim").expanduser())))
    scenario = {**SCENARIO, "environment": {"gsl_bench": str(ROOMS / number)}}
    (tmp_path / "published.yaml").write_text(yaml.safe_dump(scenario))
    assert main(["up", "published.yaml", "--in-process", "--json"]) in (0, 1)
    result = yaml.safe_load(capsys.readouterr().out)
    assert result["valid"], result
    assert result["end_reason"] == "time_limit"
    assert result["sim_time_s"] == pytest.approx(6.0)
    assert result["agents"][0]["path_length_m"] > 1.5
    assert np.isfinite(result["agents"][0]["final_distance_m"])
