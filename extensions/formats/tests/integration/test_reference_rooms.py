"""The published rooms of GSL-Bench: given a wind, and flown in."""

import json

import numpy as np
import pytest
from reference_data import ENVIRONMENTS, needs_environments

from gslcosim.cli.main import main

PLACES = {"gas.sources[0].position_m": "[5, 1, 2]", "agents[0].vehicle.start_m": "[12, 12, 0.2]"}


@needs_environments
@pytest.mark.slow
def test_a_run_uses_the_room_with_wind_solved_for_it(tmp_path, capsys):
    room = {"environment": f"{{gsl_bench: {ENVIRONMENTS / '005'}}}", "wind": "{end_time_s: 1}"}
    values = {**room, **PLACES, "referee.stop.time_limit_s": "6"}
    changes = [word for path, value in values.items() for word in ("--set", f"{path}={value}")]
    assert main(["up", "tiny_room", "--in-process", "--json", "--runs-dir", str(tmp_path), *changes]) in (0, 1)
    result = json.loads(capsys.readouterr().out)
    assert (result["valid"], result["end_reason"]) == (True, "time_limit")
    assert result["sim_time_s"] == pytest.approx(6.0)
    assert result["agents"][0]["path_length_m"] > 1.5
    assert np.isfinite(result["agents"][0]["final_distance_m"])
