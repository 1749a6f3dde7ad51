"""The bundled room for an agent that sees, flown for real; skipped where nothing can draw."""

import pytest

from gslcosim.base.errors import ModelError
from gslcosim.runtime.run import run_scenario
from gslcosim.scenario.loader import load_scenario

pytestmark = [pytest.mark.slow, pytest.mark.debian]


@pytest.mark.parametrize("start_m", [[7.5, 1.0, 0.2], [8.0, 5.0, 0.2]])
def test_the_agent_that_sees_finds_the_machine_that_leaks(start_m, tmp_path):
    overrides = ["recording.enabled=false", f"agents[0].vehicle.start_m={start_m}"]
    loaded = load_scenario("vision_room", overrides=overrides)
    try:
        flight = run_scenario(loaded, runs_dir=tmp_path, processes="one")
    except ModelError as error:
        if "expected EGL or OSMesa" not in str(error):
            raise
        pytest.skip("neither EGL nor OSMesa")
    result = flight.result["agents"][0]
    assert result["success"], result
    assert result["time_to_source_s"] < 60.0
