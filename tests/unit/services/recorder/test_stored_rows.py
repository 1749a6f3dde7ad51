"""A recording comes back as the numbers that it was made of."""

import math

import numpy as np
import pytest
from scripted_flight import ON_BOARD, SOURCE_M, ScriptedFlight

from gslcosim.base.errors import RecordingError
from gslcosim.contract import keys
from gslcosim_data import streams
from gslcosim_data.recording_reader import RecordingReader, SliceDecoder
from gslcosim_services.recorder.colors import GasScale, slice_colors
from gslcosim_services.recorder.entities import build_entities
from gslcosim_services.recorder.rerun_cli import repair_recording


def read(record, **arguments):
    flight = ScriptedFlight(**arguments)
    return flight, RecordingReader(record(**arguments)), build_entities(flight.scenario)[0]


def test_a_track_is_where_the_vehicle_was(record):
    flight, rows, names = read(record, n_ticks=1100)
    track = streams.read_track(rows, flight.scenario, names)
    assert track.tick.tolist() == list(range(1100))
    np.testing.assert_allclose(track.time_s, 0.1 * np.arange(1100))
    np.testing.assert_allclose(track.position_world_m, [flight.position_m(tick) for tick in track.tick], atol=1e-6)
    yaw_rad = flight.yaw_rad(7)
    np.testing.assert_allclose(
        track.quaternion_wxyz[7], [math.cos(yaw_rad / 2), 0, 0, math.sin(yaw_rad / 2)], atol=1e-6
    )


def test_samples_readings_and_figures_have_units_in_their_names(record):
    flight, rows, names = read(record)
    gas, wind, vector = streams.read_samples(rows, flight.scenario, names)
    assert (gas.sensor, gas.gas, gas.columns) == ("nose", "ethanol", ("mixing_ratio_ppm",))
    np.testing.assert_allclose(gas.value, 1 + np.sin(0.1 * gas.tick))
    assert (wind.sensor, wind.columns) == ("vane", ("wind_speed_m_s",))
    np.testing.assert_allclose(wind.value, 0.5)
    assert vector.columns == ("wind_x_m_s", "wind_y_m_s", "wind_z_m_s")
    np.testing.assert_allclose(np.linalg.norm(vector.values, axis=1), wind.value)
    response, speed, wind_from = streams.read_readings(rows, flight.scenario, names)
    assert response.columns == ("response_ohm",)
    np.testing.assert_allclose(response.value, 50_000.0 - response.tick)
    np.testing.assert_allclose(speed.value, 0.5)
    assert (wind_from.sensor, wind_from.columns) == ("vane", ("wind_from_rad",))
    figures = {one.columns: one for one in streams.read_figures(rows, flight.scenario, names)}
    distance, error = figures["distance_m",], figures["tracking_error_m",]
    np.testing.assert_allclose(error.value, 0.01 * error.tick)
    np.testing.assert_allclose(distance.value, [math.dist(flight.position_m(t), SOURCE_M) for t in distance.tick])


def test_on_board_sensors_come_back_with_their_axes(record):
    flight, rows, names = read(record, sensors=ON_BOARD)
    found = {(one.sensor, one.quantity): one for one in streams.read_readings(rows, flight.scenario, names)}
    force = found["imu", "specific_force"]
    assert force.columns == ("specific_force_x_m_s2", "specific_force_y_m_s2", "specific_force_z_m_s2")
    np.testing.assert_allclose(force.values[5], [1.05, 1.15, 1.25])
    (lidar_2d, lidar_3d) = streams.read_shapes(rows, flight.scenario, names, are_rays=False)
    assert lidar_3d.points_world_m.shape[1:] == (3,)
    assert len(lidar_2d.starts) == len(lidar_2d.tick) + 1
    rays = {one.sensor: one for one in streams.read_shapes(rows, flight.scenario, names, are_rays=True)}
    assert rays["four_range_finders"].points_world_m.shape[1:] == (2, 3)
    pictures = {one.sensor: one for one in streams.read_pictures(rows, flight.scenario, names)}
    camera, depth = pictures["camera"], pictures["depth_camera"]
    assert (camera.is_depth, depth.is_depth) == (False, True)
    assert (camera.size_px, camera.focal_px, camera.centre_px) == ((8, 8), (5.0, 5.0), (4.0, 4.0))
    assert camera.data[0].startswith(b"\x89PNG")


def test_gas_comes_back_within_a_level_of_its_picture(record):
    flight, rows, _ = read(record)
    slices = streams.read_slices(rows, flight.scenario)["ethanol"]
    true_ppm = flight.inbox(10)[keys.FILAMENTS].slices[0].mixing_ratio_ppm.to_array()
    found_ppm = slices.at(1.0)
    assert found_ppm.shape == slices.shape == true_ppm.shape
    seen = true_ppm > 1.03 * slices.min_ppm
    np.testing.assert_allclose(found_ppm[seen], np.minimum(true_ppm, slices.max_ppm)[seen], rtol=0.0145)
    filaments = streams.read_filaments(rows, flight.scenario)
    cloud = flight.inbox(10)[keys.FILAMENTS]
    centres_m, sigmas_m = filaments.snapshot(1)
    np.testing.assert_allclose(centres_m, cloud.position_world_m.to_array(), atol=1e-6)
    np.testing.assert_allclose(sigmas_m, cloud.sigma_m.to_array(), atol=1e-6)


def test_every_level_comes_back_as_itself():
    decoder = SliceDecoder(shape=(16, 16), scale=GasScale(max_ppm=10.0))
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    ppm = decoder.mixing_ratio_ppm(levels.T[::-1].ravel())
    assert np.all(np.diff(ppm.ravel()) > 0)
    np.testing.assert_array_equal(GasScale(max_ppm=10.0).levels(ppm), levels)


def test_of_older_recordings_colours_come_back_as_their_levels():
    palette = slice_colors()
    decoder = SliceDecoder(shape=(16, 16), scale=GasScale(max_ppm=10.0))
    levels = np.arange(256).reshape(16, 16)
    ppm = decoder.mixing_ratio_ppm(palette[levels.T[::-1]].reshape(-1)).ravel()
    assert np.all(np.diff(ppm) >= 0)
    assert len(np.unique(ppm)) == len(np.unique(palette, axis=0))


def test_a_recording_that_was_cut_off_is_refused_and_read_once_repaired(record):
    whole = record(n_ticks=1100)
    names, scenario = build_entities(ScriptedFlight().scenario)[0], ScriptedFlight().scenario
    whole.write_bytes(whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    with pytest.raises(RecordingError, match=r"cut off.*gslcosim runs repair"):
        RecordingReader(whole)
    assert repair_recording(whole)
    track = streams.read_track(RecordingReader(whole), scenario, names)
    assert 0 < len(track.tick) < 1100
    assert np.all(np.diff(track.tick) == 1)


@pytest.mark.parametrize("content", [b"", b"hello" * 100])
def test_what_is_no_recording_is_refused(tmp_path, content):
    (tmp_path / "recording.rrd").write_bytes(content)
    with pytest.raises(RecordingError, match="expected a whole one"):
        RecordingReader(tmp_path / "recording.rrd")


def test_a_recording_of_another_program_is_refused(tmp_path):
    import rerun as rr

    path = tmp_path / "recording.rrd"
    stream = rr.RecordingStream("somebody_else")
    stream.save(path)
    stream.log("points", rr.Points3D([[0, 0, 0]]))
    stream.flush()
    stream.disconnect()
    with pytest.raises(RecordingError, match="expected one of gslcosim, was one of somebody_else"):
        RecordingReader(path)
