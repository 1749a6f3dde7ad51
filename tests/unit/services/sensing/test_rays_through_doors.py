"""A range finder sees a door while it is closed, and what is behind it from the tick on in which it opens."""

import pytest
from built_messages import build_body, build_poses

from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.messages import FieldSamples
from gslcosim.contract.participant import Episode
from gslcosim_services.sensing.core import SensingCore

FINDER = "agents[0].sensors=[{model: range_finder, name: front, max_range_m: 10, noise_std: 0}]"


def step(core, tick, *events):
    poses = build_poses(tick, build_body("beetle", (1.5, 2.0, 1.0)))
    inbox = {keys.BODIES: poses, keys.SAMPLES: FieldSamples(tick=tick, samples=())}
    if tick:
        inbox[EVENTS] = EventsBeginning(tick=tick - 1, beginning=events)
    (reading,) = core.step(tick, inbox)["agents/beetle/observation"].readings
    return reading.values[0]


def test_what_is_seen_through_a_door(room_with_gate):
    opens, closes = "{what: door_opens, at_s: 10, door: gate}", "{what: door_closes, at_s: 20, door: gate}"
    core = SensingCore(*room_with_gate(opens, closes, changes=[FINDER]))
    core.reset(Episode(seed=1))
    seen_m = [step(core, tick, *events) for tick, events in enumerate([(), (), (0,), (), (1,)])]
    assert seen_m == pytest.approx([1.5, 1.5, 4.5, 4.5, 1.5], abs=0.05)
