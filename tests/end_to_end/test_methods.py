"""Every bundled search method flies for real: one digest in one process and in many, and no fault of its own."""

import math
from functools import cache
from pathlib import Path

import pytest
import yaml
from real_runs import fly, fly_here
from some_methods import every_method

from gslcosim.base.bundled import bundled_agents
from gslcosim.methods.card import find_card_beside

ROOM = Path(__file__).parents[2] / "scenarios" / "tiny_room.yaml"
TOUR = ("infotaxis",)
# One with a camera and one of several robots that talk by radio. That others answer alike in each process is a rule of
# the conformance kit, by which extensions/conformance/tests/conformance/test_methods.py checks one of each family.
SOME = ("vision_prior", "sniffy_squad")
SENSORS_OF_KIND = {
    "gas": [{"model": "pid", "name": "nose"}, {"model": "pid", "name": "nose_right", "mount_m": [0.0, -0.2, 0.0]}],
    "gas_ppm": [{"model": "pid", "name": "nose"}, {"model": "pid", "name": "nose_right", "mount_m": [0.0, -0.2, 0.0]}],
    "gas_ohm": [{"model": "tgs2600", "name": "nose"}, {"model": "tgs2600", "name": "nose_right"}],
    "wind": [{"model": "anemometer", "name": "wind"}],
    "range": [{"model": "four_range_finders", "name": "ranges"}],
    "camera": [{"model": "camera", "name": "eye", "camera": {"width_px": 16, "height_px": 16}, "period_s": 0.5}],
}
# Places in the tiny room for up to five robots.
STARTS_M = ([4.5, 2.5, 0.05], [4.5, 1.2, 0.05], [4.5, 3.8, 0.05], [3.2, 1.2, 0.05], [3.2, 3.8, 0.05])

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end]


@cache
def card_of(name):
    return find_card_beside(bundled_agents()[name])


def sensors_for(card):
    found = {}
    for kind, n in card.needs.sensors.items():
        found |= {sensor["name"]: sensor for sensor in SENSORS_OF_KIND[kind][:n]}
    return list(found.values()) or [{"model": "pid", "name": "nose"}]


@pytest.fixture
def scenario_of(tmp_path):
    """Write the tiny room's scenario with a method, and with all that its card needs."""

    def write(name):
        card = card_of(name)
        # A method with a camera looks around first.
        time_limit_s = 20 if "camera" in card.needs.sensors else 10
        fields = yaml.safe_load(ROOM.read_text())
        n_robots = card.robots[0] if isinstance(card.robots, tuple) else card.robots
        agent = {
            "vehicle": {"model": "crazyflie", "search_height_m": 1, "hold_s": 0.5},
            "sensors": sensors_for(card),
            "knows": dict.fromkeys(card.needs.knows, True),
            # A slow machine may compile in a first answer.
            "answer_within_s": 300.0,
        }
        fields["agents"] = [
            {
                **agent,
                "name": f"robot_{i + 1}",
                "start": {"process_of": "robot_1"} if i else {"python": name},
                "vehicle": {**agent["vehicle"], "start_m": STARTS_M[i], "separation_m": 0.3 if n_robots > 1 else 0.0},
            }
            for i in range(n_robots)
        ]
        if card.needs.radio:
            fields["channels"] = [{"name": "radio", "max_bytes": 1024}]
        fields["referee"] = {"success": {"within_m": 0.2, "of": "source"}, "stop": {"time_limit_s": time_limit_s}}
        path = tmp_path / f"{name}.yaml"
        path.write_text(yaml.safe_dump(fields, sort_keys=False))
        return path

    return write


@every_method(TOUR, SOME)
def test_it_runs_alike_in_one_process_and_in_many(name, scenario_of, tmp_path):
    scenario = scenario_of(name)
    multi = fly(scenario, tmp_path / "multi")
    if "expected EGL or OSMesa" in multi.errors:
        pytest.skip("cameras need EGL or OSMesa")
    single = fly_here(scenario, tmp_path / "single")
    assert multi.result["valid"], multi.errors
    assert multi.result["faults"] == single.result["faults"] == []
    assert multi.result["digest"] == single.result["digest"]
    for agent in multi.result["agents"]:
        assert agent["outcome"] in ("success", "time_limit")
        assert agent["knows"] == list(card_of(name).needs.knows)
        assert (agent["belief"] is not None) == card_of(name).believes
        if agent["belief"]:
            assert 0.0 <= agent["belief"]["mass_near_frac"] <= 1.0
            assert math.isfinite(agent["belief"]["expected_distance_m"])
