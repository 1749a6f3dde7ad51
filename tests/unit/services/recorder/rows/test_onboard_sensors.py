"""Rows of lidars and cameras when a reading is sent again."""

import numpy as np
from contract_examples import EXAMPLES
from scripted_flight import scenario

from gslcosim.contract.messages import Reading
from gslcosim.contract.record import NumericArray
from gslcosim_services.recorder.entities import build_entities
from gslcosim_services.recorder.rows.columns import RecordingRows
from gslcosim_services.recorder.rows.onboard_sensors import ImageRows, PoseHistory, RangeRows

TICK_NS = 100_000_000
BODY = (
    EXAMPLES["bodies_flying"]
    .bodies[0]
    .model_copy(update={"position_world_m": (0.0, 0.0, 2.0), "quaternion_wxyz": (1.0, 0.0, 0.0, 0.0)})
)


class SentRows:
    """Stands for a file: keeps which entity got how many rows."""

    def __init__(self):
        self.drawn, self.sent = [], []

    def draw(self, entity, *parts):
        self.drawn.append(entity)

    def send(self, entity, ticks, columns):
        self.sent.append((entity, list(ticks), list(columns)))


def make_sensor(**block):
    (names,) = build_entities(scenario(sensors=(block,)))
    ((spec, _),) = names.on_board_sensors
    file = SentRows()
    return names, spec, PoseHistory([spec], TICK_NS), RecordingRows(file), file


def test_a_scan_that_is_sent_again_because_a_command_is_awaited_is_recorded_once():
    names, spec, poses, rows, file = make_sensor(model="lidar_2d", name="scan", period_s=0.5, lidar={"n_azimuths": 1})
    scans = RangeRows(rows, names, spec, poses, TICK_NS)
    ranges = NumericArray.from_array(np.ones((1, 1), np.float32))
    for tick in range(8):
        poses.add(tick, BODY)
        scans.add_reading(tick, Reading(sensor="scan", quantity="range", unit="m", values=(1.0,), array=ranges))
    rows.send()
    assert [ticks for _, ticks, _ in file.sent] == [[0, 5]]


def test_a_picture_that_is_sent_twice_is_recorded_once():
    names, spec, poses, rows, file = make_sensor(model="camera", name="eye")
    image = EXAMPLES["images"].frames[0].image
    reading = Reading(sensor="eye", quantity="picture", unit="1", values=(), image=image)
    images = ImageRows(rows, names, spec, poses)
    poses.add(64, BODY)
    images.add_reading(64, reading)
    rows.send()
    images.add_reading(65, reading)
    images.add_reading(66, reading.model_copy(update={"image": image.model_copy(update={"taken_tick": 66})}))
    rows.send()
    assert [ticks for _, ticks, _ in file.sent] == [[64], [66]]
    assert file.drawn == ["seen/agent_0/eye"]
