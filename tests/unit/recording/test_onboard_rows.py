"""What is recorded of lidars and cameras."""

import numpy as np
import pytest

from gslcosim.contract.arrays import NumericArray
from gslcosim.contract.examples import EXAMPLES
from gslcosim.contract.messages import Reading
from gslcosim.recording.onboard_rows import ImageRows, LidarRows
from gslcosim.scenario.models import SensorSpec


class SentRows:
    """Stands for a file: keeps which entity got how many rows."""

    def __init__(self):
        self.drawn, self.sent = [], []

    def draw(self, entity, *parts):
        self.drawn.append(entity)

    def send(self, entity, ticks, columns):
        self.sent.append((entity, list(ticks), list(columns)))


def test_points_of_a_scan_are_what_is_nearer_than_its_reach():
    spec = SensorSpec.model_validate(
        {"model": "lidar_2d", "name": "scan", "mount_m": (0, 0, 0.5), "max_range_m": 5.0, "lidar": {"n_azimuths": 4}}
    )
    rows, file = LidarRows("vehicles/a/scan", spec, (255, 0, 0)), SentRows()
    ranges = NumericArray.from_array(np.array([[1.0, 5.0, 2.0, 5.0]], np.float32))
    scan = Reading(sensor="scan", quantity="range", unit="m", values=(1.0,), array=ranges)
    rows.add(3, scan)
    rows.add(4, scan.model_copy(update={"array": None}))
    rows.send(file)
    rows.send(file)
    ((entity, ticks, (column,)),) = file.sent
    assert (entity, ticks, file.drawn) == ("vehicles/a/scan", [3], ["vehicles/a/scan"])
    points_m = np.array(column.as_arrow_array().to_pylist()[0])
    assert points_m == pytest.approx(np.array([[-1.0, 0.0, 0.5], [2.0, 0.0, 0.5]]), abs=1e-6)


def test_a_picture_that_is_told_twice_is_recorded_once():
    image = EXAMPLES["images"].frames[0].image
    reading = Reading(sensor="eye", quantity="picture", unit="1", values=(), image=image)
    rows, file = ImageRows("vehicles/a/eye"), SentRows()
    rows.add(64, reading)
    rows.send(file)
    rows.add(65, reading)
    rows.add(66, reading.model_copy(update={"image": image.model_copy(update={"taken_tick": 66})}))
    rows.send(file)
    assert [ticks for _, ticks, _ in file.sent] == [[64], [66]]
    assert file.drawn == ["vehicles/a/eye"]
