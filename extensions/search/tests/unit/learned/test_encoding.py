import math

import numpy as np
import pytest
from briefings import MODELS, briefing, observation

from gslcosim.base.errors import UsageError
from gslcosim.contract.messages import Command, Reading, SensorDescription
from gslcosim.contract.record import NumericArray
from gslcosim_search.learned.encoding import (
    N_HEADINGS,
    N_SECTORS,
    ObservationVector,
    action_kind,
    amount,
    closeness,
)
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


def command(kind, action, *, at_m=(7.0, 5.0, 1.0), **settings):
    return action_kind(kind, briefing(), **settings).command(observation(position_m=at_m), action)


def test_a_waypoint_is_an_offset_at_the_search_height():
    assert command("waypoint", [0.5, -1.0], step_m=2.0, hold_s=0.5) == Command(
        tick=40, kind="waypoint", position_world_m=(8.0, 3.0, 2.0), hold_s=0.5
    )
    assert command("waypoint_3d", [0.0, 0.0, 1.0]).position_world_m == (7.0, 5.0, 2.0)


def test_headings_go_round_and_the_last_choice_holds():
    ends_m = [command("heading", choice).position_world_m for choice in range(N_HEADINGS)]
    bearings = [math.atan2(y_m - 5.0, x_m - 7.0) % (2 * math.pi) for x_m, y_m, _ in ends_m]
    assert bearings == pytest.approx([i * math.pi / 4 for i in range(N_HEADINGS)], abs=1e-9)
    assert command("heading", N_HEADINGS).kind == "hold"


def test_velocities_and_drives_are_scaled():
    assert command("velocity", [1.0, -0.5], speed_m_s=0.8).velocity_world_m_s == (0.8, -0.4, 0.0)
    assert command("velocity_3d", [0.0, 0.0, 1.0]).velocity_world_m_s == (0.0, 0.0, 1.0)
    drive = command("drive", [1.0, -0.5], speed_m_s=0.3).drive
    assert (drive.speed_m_s, drive.yaw_rate_rad_s) == (0.3, -0.5)


def test_another_kind_is_refused():
    with pytest.raises(UsageError, match=r"action: expected one of waypoint, waypoint_3d, heading, .*, was 'jump'"):
        action_kind("jump", briefing())
