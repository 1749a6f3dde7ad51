import math

import numpy as np
import pytest
from briefings import MODELS, briefing, observation
from hypothesis import given
from hypothesis import strategies as st

from gslcosim.contract.messages import Reading, SensorDescription
from gslcosim.contract.record import NumericArray
from gslcosim_search.learned.encoding import N_SECTORS, ObservationVector, amount, closeness
from gslcosim_services.sensing.models import sensor_kind, sensor_names


def seen(vector, **changes):
    return dict(zip(vector.names, vector.of(observation(**changes)).tolist(), strict=True))


def test_the_pose_is_relative_to_the_room():
    vector = ObservationVector(briefing(size_m=(15.0, 10.0, 8.0)))
    vector_of = seen(vector, position_m=(15.0, 5.0, 2.0), yaw_rad=math.pi / 2, tick=1500, notice="refused")
    assert (vector_of["x"], vector_of["y"], vector_of["z"]) == pytest.approx((1.0, 0.0, -0.5))
    assert (vector_of["yaw_sin"], vector_of["yaw_cos"]) == pytest.approx((1.0, 0.0), abs=1e-6)
    assert (vector_of["time"], vector_of["refused"]) == pytest.approx((0.5, 1.0))


def test_sensors_follow_in_the_briefings_order():
    vector = ObservationVector(briefing())
    assert vector.names[10:] == (
        "nose.log_resistance", "vane.speed", "vane.from_sin", "vane.from_cos", "nose_ppm.amount",
    )  # fmt: skip
    vector_of = seen(vector, readings={"nose": 1e4, "nose_ppm": 10_000.0, "vane": (0.0, math.pi / 2)})
    assert list(vector_of.values())[10:] == pytest.approx([0.0, 0.0, 1.0, 0.0, 1.0], abs=1e-6)


def test_a_sensor_that_warms_up_shows_nothing():
    vector = ObservationVector(briefing())
    assert seen(vector, warming=["vane"])["vane.from_cos"] == 0.0


def test_pictures_have_no_numbers():
    vector = ObservationVector(briefing(sensors=(("pid", "nose"), ("camera", "eye"))))
    assert vector.left_out == ("eye",)
    assert vector.names[10:] == ("nose.amount",)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_amounts_keep_their_order_and_sign(a_ppm, b_ppm):
    assert (amount(a_ppm) <= amount(b_ppm)) == (a_ppm <= b_ppm) or amount(a_ppm) == amount(b_ppm)
    assert math.copysign(1, amount(a_ppm)) == math.copysign(1, a_ppm)


def test_amounts_and_ranges_have_these_scales():
    assert amount(0.0) == 0.0
    assert amount(10_000.0) == pytest.approx(1.0)
    assert (closeness(0.0), closeness(1.0)) == (1.0, 0.5)


def test_a_lidar_shows_the_nearest_in_each_sector_until_it_shows_again():
    directions = NumericArray.from_array(np.zeros((2, 360, 3), np.float32))
    lidar = SensorDescription(
        name="lidar", model="lidar_3d", quantity="range", unit="m", mount_body_m=(0, 0, 0), directions_body=directions
    )
    vector = ObservationVector(briefing().model_copy(update={"sensors": (lidar,)}))
    ranges = np.full((2, 360), 9.0, np.float32)
    ranges[1, 100] = 1.0
    reading = Reading(sensor="lidar", quantity="range", unit="m", values=(1.0,))
    new = reading.model_copy(update={"array": NumericArray.from_array(ranges)})
    with_array = vector.of(observation().model_copy(update={"readings": (new,)}))
    without = vector.of(observation().model_copy(update={"readings": (reading,)}))
    assert with_array.tolist() == without.tolist()
    assert len(with_array) == 10 + N_SECTORS
    expected = [0.1] * N_SECTORS
    expected[100 * N_SECTORS // 360] = 0.5
    assert with_array[10:].tolist() == pytest.approx(expected)


def test_every_sensor_is_shown_or_is_known_not_to_be():
    """A sensor that is added gets its numbers, or a place in this list."""
    kinds = {name: sensor_kind(name) for name in sensor_names()}
    described = [
        SensorDescription(name=name, model=name, quantity=kind.quantity, unit=kind.unit, mount_body_m=(0, 0, 0))
        for name, kind in kinds.items()
    ]
    vector = ObservationVector(briefing().model_copy(update={"sensors": tuple(described)}))
    assert set(vector.left_out) == {"gps", "pose", "camera", "depth_camera"}
    assert MODELS.keys() <= kinds.keys()
