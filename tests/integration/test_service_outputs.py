"""Services make messages without checks: what they write would pass them all, and be written the same again."""

import pytest
from built_runs import build_setup

from gslcosim.contract import codec
from gslcosim.runtime.in_process import run_in_process
from gslcosim.runtime.network import Network
from gslcosim.scenario.loader import load_scenario

FOR_SECONDS = {"tiny_room": 20, "swarm_tiny": 20, "event_sensor": 20, "event_radio": 20, "on_board_sensors": 5}


@pytest.mark.slow
@pytest.mark.parametrize("name", FOR_SECONDS)
def test_every_message_of_a_run_passes_all_checks_and_comes_back_byte_for_byte(name, tmp_path):
    cut = [f"referee.stop.time_limit_s={FOR_SECONDS[name]}", "recording.enabled=false"]
    loaded = load_scenario(name, overrides=cut)
    setup = build_setup(loaded, tmp_path)
    seen = set()

    def watch(port, message):
        payload = codec.encode(message)
        assert codec.encode(codec.decode(type(message), payload)) == payload, port
        assert codec.decode_trusted(type(message), payload) == message, port
        seen.add(port)

    outcome = run_in_process(setup, loaded.directory, Network(), lambda _: None, watch)
    assert outcome.fault is None, outcome.fault
    assert {"truth/bodies", "truth/samples", "referee/score", "referee/verdict"} <= seen
