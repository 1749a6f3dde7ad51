"""What the sensors of a run report is in its recording, number by number."""

import io

import numpy as np
import pytest
from PIL import Image
from recording_content import column, still
from scripted_flight import CAMERA_EVERY_TICKS, LIDAR_SHAPES, ON_BOARD, ScriptedFlight

from gslcosim.base.frames import world_from_body_rotation
from gslcosim.contract import keys
from gslcosim_services.sensing.models.range_finders import ray_directions_body

N_TICKS = 6
PLOTS = "/plots/on_board/agent_0"
SPACE = "/seen/agent_0"
# The curves of each sensor: where its values begin and end.
CURVES = {
    "imu/specific_force": (0, 3),
    "imu/angular_velocity": (3, 6),
    "gps/position": (0, 3),
    "gps/velocity": (3, 6),
    "barometer/pressure": (0, 1),
    "magnetometer/magnetic_field": (0, 3),
    "pose/position": (0, 3),
    "pose/attitude_quaternion": (3, 7),
    "pose/velocity": (7, 10),
    "range_finder/range": (0, 1),
    "four_range_finders/ranges": (0, 4),
    "lidar_2d/least_range": (0, 1),
    "lidar_3d/least_range": (0, 1),
    "bump/contact": (0, 1),
}


@pytest.fixture
def flown(record):
    """Return the readings of every on-board sensor, by sensor, and the file that they are recorded in."""
    flight = ScriptedFlight(n_ticks=N_TICKS, sensors=ON_BOARD)
    observations = [flight.inbox(tick)[keys.observation("agent_0")] for tick in range(N_TICKS)]
    readings = {
        sensor["name"]: [observation.reading(sensor["name"]) for observation in observations] for sensor in ON_BOARD
    }
    return flight, readings, record(n_ticks=N_TICKS, sensors=ON_BOARD)


def test_every_value_is_a_curve_under_its_quantity_and_none_is_among_those_of_gas(flown, rows_of):
    _, readings, path = flown
    for place, (first, end) in CURVES.items():
        ticks, _, values = column(path, f"{PLOTS}/{place}", "Scalars:scalars")
        assert ticks == list(range(N_TICKS))
        expected = [reading.values[first:end] for reading in readings[place.split("/")[0]]]
        np.testing.assert_array_equal(values, expected, err_msg=place)
        assert len(still(path, f"{PLOTS}/{place}", "SeriesLines:names")) == end - first
    drawn = {entity for entity in rows_of(path) if entity.startswith("/plots/")}
    assert drawn == {f"{PLOTS}/{place}" for place in CURVES} | {
        "/plots/distance_m/agent_0",
        "/plots/tracking_error_m/agent_0",
        "/plots/decision_ms/agent_0",
    }


def test_rays_reach_from_their_mount_to_what_they_meet(flown):
    flight, readings, path = flown
    for sensor in flight.scenario.agents[0].sensors:
        if sensor.model in {"range_finder", "four_range_finders"}:
            ticks, _, rays_m = column(path, f"{SPACE}/{sensor.name}", "LineStrips3D:strips")
            assert ticks == list(range(N_TICKS))
            for tick, rays in enumerate(rays_m):
                ends_m = np.array(readings[sensor.name][tick].values)[:, None] * ray_directions_body(sensor)
                strips_m = np.stack([np.zeros_like(ends_m), ends_m], axis=1)
                np.testing.assert_allclose(rays, flight.world_m(tick, strips_m), atol=1e-5)


def test_a_ray_that_meets_nothing_has_no_length(record):
    nearsighted = ({"model": "four_range_finders", "name": "around", "max_range_m": 1.15, "mount_m": (0, 0, 0.1)},)
    _, _, rays_m = column(record(n_ticks=1, sensors=nearsighted), f"{SPACE}/around", "LineStrips3D:strips")
    strips_m = [[[0, 0, 0.1], end] for end in ([1, 0, 0.1], [0, 1.1, 0.1], [0, 0, 0.1], [0, 0, 0.1])]
    np.testing.assert_allclose(rays_m[0], ScriptedFlight().world_m(0, strips_m), atol=1e-5)


def test_points_of_lidars_lie_where_their_rays_end(flown):
    flight, readings, path = flown
    for sensor in flight.scenario.agents[0].sensors:
        if sensor.model in LIDAR_SHAPES:
            ticks, _, points_m = column(path, f"{SPACE}/{sensor.name}", "Points3D:positions")
            assert ticks == list(range(N_TICKS))
            for tick, cloud_m in enumerate(points_m):
                ranges_m = readings[sensor.name][tick].array.to_array()
                ends_m = (ranges_m[..., None] * ray_directions_body(sensor))[ranges_m < sensor.max_range_m]
                np.testing.assert_allclose(cloud_m, flight.world_m(tick, ends_m), rtol=1e-5, atol=1e-5)


def test_what_comes_late_is_drawn_once_and_from_where_it_was_seen(record):
    slow = {"period_s": 0.3, "delay_s": 0.2, "mount_m": (0.1, 0, 0)}
    path = record(n_ticks=8, sensors=({"model": "range_finder", "name": "ahead", **slow},))
    ticks, _, rays_m = column(path, f"{SPACE}/ahead", "LineStrips3D:strips")
    assert ticks == [0, 3, 6]
    flight = ScriptedFlight()
    for tick, rays in zip((3, 6), rays_m[1:], strict=True):
        strip_m = [[(0.1, 0.0, 0.0), (1.1 + 0.01 * tick, 0.0, 0.0)]]
        np.testing.assert_allclose(rays, flight.world_m(tick - 2, strip_m), atol=1e-5)


@pytest.mark.parametrize(
    ("camera", "component"), [("camera", "EncodedImage:blob"), ("depth_camera", "EncodedDepthImage:blob")]
)
def test_each_picture_is_there_once_as_it_travelled_and_with_its_calibration(flown, camera, component):
    _, readings, path = flown
    ticks, _, blobs = column(path, f"{SPACE}/{camera}", component)
    assert ticks == list(range(0, N_TICKS, CAMERA_EVERY_TICKS))
    images = [reading.image for reading in readings[camera]][::CAMERA_EVERY_TICKS]
    assert [bytes(blob[0]) for blob in blobs] == [image.data for image in images]
    # By columns, as Rerun has it.
    (matrix,) = still(path, f"{SPACE}/{camera}", "Pinhole:image_from_camera")
    assert matrix == [5.0, 0.0, 0.0, 0.0, 5.0, 0.0, 4.0, 4.0, 1.0]
    assert still(path, f"{SPACE}/{camera}", "Pinhole:resolution") == [[8.0, 8.0]]


def test_each_picture_hangs_before_the_eye_that_took_it(flown):
    flight, _, path = flown
    ticks, _, places_m = column(path, f"{SPACE}/camera", "Transform3D:translation")
    _, _, quaternions = column(path, f"{SPACE}/camera", "Transform3D:quaternion")
    assert ticks == list(range(0, N_TICKS, CAMERA_EVERY_TICKS))
    for tick, (place_m,), ((x, y, z, w),) in zip(ticks, places_m, quaternions, strict=True):
        np.testing.assert_allclose(place_m, flight.world_m(tick, (0.1, 0.0, 0.0)), atol=1e-6)
        world_from_eye = world_from_body_rotation((w, x, y, z))
        ahead_m = flight.world_m(tick, (1.1, 0.0, 0.0))
        np.testing.assert_allclose(place_m + world_from_eye @ [0.0, 0.0, 1.0], ahead_m, atol=1e-6)
        # Down in the picture is down in the room.
        np.testing.assert_allclose(world_from_eye @ [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], atol=1e-6)


def test_depths_are_metres_when_divided_by_their_unit(flown):
    flight, readings, path = flown
    (units_per_m,) = still(path, f"{SPACE}/depth_camera", "EncodedDepthImage:meter")
    _, _, blobs = column(path, f"{SPACE}/depth_camera", "EncodedDepthImage:blob")
    depths_m = np.asarray(Image.open(io.BytesIO(bytes(blobs[1][0])))) / units_per_m
    assert depths_m == pytest.approx(1.002)
    (least, most) = still(path, f"{SPACE}/depth_camera", "EncodedDepthImage:depth_range")[0]
    reach_m = next(sensor.max_range_m for sensor in flight.scenario.agents[0].sensors if sensor.name == "depth_camera")
    assert (least, most / units_per_m) == (0.0, reach_m)
    assert readings["depth_camera"][0].image is not None


def test_what_is_read_before_an_instrument_is_warm_is_no_curve(record):
    def warm_up(inbox):
        observation = inbox[keys.observation("agent_0")]
        is_warming_up = observation.tick < 3
        readings = tuple(each.model_copy(update={"is_warming_up": is_warming_up}) for each in observation.readings)
        return {**inbox, keys.observation("agent_0"): observation.model_copy(update={"readings": readings})}

    ticks, _, _ = column(record(n_ticks=5, edit=warm_up), "/plots/response/agent_0/nose", "Scalars:scalars")
    assert ticks == [3, 4]


def test_an_anemometer_of_three_axes_is_a_curve_of_the_winds_speed(record, rows_of):
    path = record(n_ticks=2, sensors=({"model": "anemometer_3d", "name": "wind"},))
    _, _, speeds_m_s = column(path, "/plots/wind_m_s/agent_0/wind/measured", "Scalars:scalars")
    assert speeds_m_s[0] == pytest.approx([np.linalg.norm([1.0, 1.1, 1.2])])
    assert not [entity for entity in rows_of(path) if entity.startswith("/plots/response")]


def test_the_beam_of_a_laser_ends_where_it_is_reflected(record):
    laser = ({"model": "tdlas", "name": "laser", "beam_body": (0.0, 0.0, -2.0), "mount_m": (0.1, 0.0, 0.0)},)
    ticks, _, beams_m = column(record(n_ticks=2, sensors=laser), f"{SPACE}/laser", "LineStrips3D:strips")
    assert ticks == [0, 1]
    expected_m = ScriptedFlight().world_m(1, [[[0.1, 0.0, 0.0], [0.1, 0.0, -1.01]]])
    np.testing.assert_allclose(beams_m[1], expected_m, atol=1e-6)


def test_what_a_vehicle_touches_is_in_the_log_and_marked_where_it_began(record):
    contacts = (("floor",), ("floor",), (), ("rack",), ("rack", "agent_1"), ("rack",), (), ("rack",))
    path = record(n_ticks=10, contacts=contacts)
    ticks, _, lines = column(path, "/contacts", "TextLog:text")
    assert list(zip(ticks, (line for (line,) in lines), strict=True)) == [
        (0, "agent_0 touches floor"),
        (2, "agent_0 is off floor after 0.2 s"),
        (3, "agent_0 touches rack"),
        (4, "agent_0 touches agent_1"),
        (5, "agent_0 is off agent_1 after 0.1 s"),
        (6, "agent_0 is off rack after 0.3 s"),
        (7, "agent_0 touches rack"),
        (8, "agent_0 is off rack after 0.1 s"),
    ]
    ticks, _, labels = column(path, "/markers/agent_0", "Points3D:labels")
    marked = {tick: label for tick, (label,) in zip(ticks, labels, strict=True) if label != "start"}
    assert marked == {3: "touches rack", 4: "touches agent_1", 7: ""}
    ticks, _, points_m = column(path, "/markers/agent_0", "Points3D:positions")
    np.testing.assert_allclose(points_m[ticks.index(4)], [ScriptedFlight().position_m(4)], rtol=1e-6)
