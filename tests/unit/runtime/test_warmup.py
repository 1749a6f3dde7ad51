"""A rehearsal loads kernels and leaves no trace."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from gslcosim.contract import keys
from gslcosim.contract.messages import BodyPoses, CameraFrames, FieldSamples, RadioTraffic
from gslcosim.contract.participant import Episode
from gslcosim.runtime.warmup import warm_up
from gslcosim_services.sensing.core import SensingCore

SENSORS = [
    {"model": "tgs2600", "name": "nose"},
    {"model": "imu", "name": "imu"},
    {"model": "lidar_2d", "name": "scan", "noise_std": 0.1},
    {"model": "camera", "name": "eye"},
]


class Listening:
    """Stands before a core and keeps what it is given."""

    def __init__(self, core):
        self.core, self.spec, self.inboxes = core, core.spec, []

    def reset(self, episode):
        return self.core.reset(episode)

    def step(self, tick, inbox):
        self.inboxes.append(inbox)
        return self.core.step(tick, inbox)


@pytest.fixture
def scenario(make_scenario):
    return make_scenario({}, {}, sensors=SENSORS, channels=[{"name": "radio"}])


def test_sensing_is_warmed_up_with_all_that_it_reads_and_starts_afresh(scenario, make_room):
    core = Listening(SensingCore(scenario, make_room()))
    warm_up(core, scenario)
    assert len(core.inboxes) == 2
    types = {port: type(message) for port, message in core.inboxes[0].items()}
    expected = {keys.BODIES: BodyPoses, keys.SAMPLES: FieldSamples, keys.RADIO: RadioTraffic, keys.IMAGES: CameraFrames}
    assert types == expected
    after = [core.reset(Episode(seed=4)), core.step(0, core.inboxes[0])]
    new = SensingCore(scenario, make_room())
    assert [new.reset(Episode(seed=4)), new.step(0, core.inboxes[0])] == after


@pytest.mark.slow
def test_nothing_is_compiled_in_a_run():
    """Planning and keeping apart included; in a process in which no other test has used a kernel before."""
    flight = Path(__file__).parent / "warmed_up_run.py"
    ended = subprocess.run([sys.executable, flight], capture_output=True, text=True, check=True)
    found = json.loads(ended.stdout)
    assert found["in_flight"] == []
    assert found["n_bends"] > 1
    assert found["n_rehearsed"] > 8
