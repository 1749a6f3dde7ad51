"""A run as tables and as messages of ROS 2, read back by other packages, equal to the run."""

import json
import re
import sqlite3
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
import yaml

import gslcosim_data
from gslcosim.base.errors import UsageError
from gslcosim.cli.main import main
from gslcosim_data.run import RunData

PAGE = Path(__file__).parents[4] / "docs" / "extract.md"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A run with every on-board sensor that needs no pictures, of a method with beliefs; its folder."""
    runs = tmp_path_factory.mktemp("runs")
    method = "agents[0].start.python=infotaxis"
    limit = "referee.stop.time_limit_s=8"
    sensors = (
        "[{model: tgs2600, name: nose}, {model: anemometer, name: wind}, {model: imu, name: imu},"
        "{model: gps, name: gps}, {model: barometer, name: barometer}, {model: magnetometer, name: compass},"
        "{model: pose, name: pose}, {model: range_finder, name: below, beam_body: [0, 0, -1]},"
        "{model: lidar_2d, name: scan, period_s: 0.2, lidar: {n_azimuths: 90}, mount_rpy_rad: [0, 0, 0.5]},"
        "{model: lidar_3d, name: cloud, period_s: 1, lidar: {n_azimuths: 30, n_elevations: 3}}]"
    )
    words = ["up", "tiny_room", "--in-process", "--quiet", "--runs-dir", str(runs)]
    main([*words, "--set", method, "--set", limit, "--set", f"agents[0].sensors={sensors}"])
    return next(runs.iterdir())


def extracted(flown, to, tmp_path):
    assert main(["extract", str(flown), "--to", to, "--out", str(tmp_path / to)]) == 0
    return tmp_path / to


@pytest.mark.slow
@pytest.mark.tour
def test_tables_hold_what_the_run_holds(flown, tmp_path, capsys):
    run = gslcosim_data.open_run(flown)
    folder = extracted(flown, "parquet", tmp_path)
    assert capsys.readouterr().out.split()[0] == str(folder / "dictionary.csv")
    track = pyarrow.parquet.read_table(folder / "track_beetle.parquet")
    for i, axis in enumerate("xyz"):
        np.testing.assert_array_equal(track[f"{axis}_m"].to_numpy(), run.tracks["beetle"].position_world_m[:, i])
    readings = pyarrow.parquet.read_table(folder / "readings_beetle.parquet")
    nose = next(series for series in run.readings if series.sensor == "nose")
    np.testing.assert_array_equal(readings["nose_response_ohm"].to_numpy(), nose.value)
    assert len(pyarrow.parquet.read_table(folder / "commands.parquet")) == len(run.commands["beetle"])
    belief = pyarrow.parquet.read_table(folder / "belief_beetle.parquet")
    first = belief["probability"].to_numpy()[belief["tick"].to_numpy() == belief["tick"][0].as_py()]
    assert first.sum() == pytest.approx(1, abs=1e-3)
    gas = pyarrow.parquet.read_table(folder / "gas_ethanol.parquet")
    last = gas["mixing_ratio_ppm"].to_numpy()[gas["time_s"].to_numpy() == gas["time_s"][-1].as_py()]
    np.testing.assert_array_equal(np.sort(last), np.sort((p := run.gas_slices["ethanol"].at(99.0))[p > 0]))


@pytest.mark.slow
def test_a_table_of_a_run_is_the_file_of_extract(flown, tmp_path):
    run = gslcosim_data.open_run(flown)
    folder = extracted(flown, "parquet", tmp_path)
    assert {f"{name}.parquet" for name in run.table_names} == {path.name for path in folder.glob("*.parquet")}
    track = run.table("track_beetle")
    assert track.equals(pyarrow.parquet.read_table(folder / "track_beetle.parquet"), check_metadata=True)
    assert track.schema.field("x_m").metadata[b"unit"] == b"m"
    of_all = run.table("track")
    assert of_all.column_names == ["agent", *track.column_names]
    assert set(of_all["agent"].to_pylist()) == {"beetle"}
    with pytest.raises(UsageError, match=r"expected a table of track_beetle, .*, was 'pose'"):
        run.table("pose")


@pytest.mark.slow
@pytest.mark.extras
def test_xarray_opens_a_run_and_what_extract_writes_of_it(flown, tmp_path):
    xarray = pytest.importorskip("xarray")
    run = gslcosim_data.open_run(flown)
    gas = run.to_xarray()
    slices = run.gas_slices["ethanol"]
    np.testing.assert_array_equal(gas["ethanol_ppm"].sel(time_s=5.0, method="ffill").values, slices.at(5.0))
    assert gas["ethanol_ppm"].max() > 0
    assert xarray.open_dataset(flown).equals(gas)
    folder = extracted(flown, "netcdf", tmp_path)
    with xarray.open_dataset(folder / "gas.nc", decode_cf=False) as raw:
        assert raw.attrs["history"]
        assert [name for name in ("time_s", "x_m", "y_m", "height_m") if "_FillValue" in raw[name].attrs] == []
    with xarray.open_dataset(folder / "gas.nc") as written:
        assert written.equals(gas)
    with xarray.open_dataset(folder / "wind.nc") as written:
        np.testing.assert_array_equal(written["wind_x_m_s"].values, run.environment.wind.velocity_m_s[..., 0])


@pytest.mark.slow
def test_every_column_is_in_the_dictionary_and_csv_equals_parquet(flown, tmp_path):
    as_parquet, as_csv = extracted(flown, "parquet", tmp_path), extracted(flown, "csv", tmp_path)
    dictionary = json.loads((as_csv / "dictionary.json").read_text())
    assert {table["file"] for table in dictionary["tables"]} == {p.name for p in as_csv.glob("*.csv")} - {
        "dictionary.csv"
    }
    for table in dictionary["tables"]:
        text = pyarrow.csv.read_csv(as_csv / table["file"])
        binary = pyarrow.parquet.read_table((as_parquet / table["file"]).with_suffix(".parquet"))
        assert text.column_names == binary.column_names == [column["name"] for column in table["columns"]]
        assert all(column["meaning"] for column in table["columns"])
        for column in table["columns"]:
            unit = re.sub(r"\W+", "_", column["unit"].lower().replace("^", ""))
            assert column["name"].endswith(unit), "names carry units"
        for name in text.column_names:
            if text[name].type in ("double", "int64"):
                np.testing.assert_allclose(
                    text[name].to_numpy(), binary[name].to_numpy().astype(np.float64), rtol=1e-6, equal_nan=True
                )
        assert binary.schema.metadata[b"meaning"].decode() == table["meaning"]


def checked(messages, run):
    """Compare messages of a run, by topic, with the run."""
    track = run.tracks["beetle"]
    poses = messages["/beetle/odom"]
    assert [stamp for stamp, _ in poses] == [int(tick) * run.scenario.tick_ns for tick in track.tick]
    for i in (0, 20, len(poses) - 1):
        _, odometry = poses[i]
        place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
        assert (place.x, place.y, place.z) == tuple(track.position_world_m[i])
        assert (turn.w, turn.x, turn.y, turn.z) == tuple(track.quaternion_wxyz[i])
    speeds = [
        np.linalg.norm([o.twist.twist.linear.x, o.twist.twist.linear.y, o.twist.twist.linear.z]) for _, o in poses
    ]
    moved_m = float(np.trapezoid(speeds, track.time_s))
    assert moved_m == pytest.approx(run.result["agents"][0]["path_length_m"], rel=0.03)
    dictionary = {(series.sensor, series.quantity): series for series in run.readings}
    _check(messages["/beetle/nose"], dictionary["nose", "response"].value, lambda m: m.raw)
    assert {m.raw_units for _, m in messages["/beetle/nose"]} == {5}
    _check(messages["/beetle/wind"], dictionary["wind", "wind_from"].value, lambda m: m.wind_direction)
    _check(messages["/beetle/imu"], dictionary["imu", "specific_force"].values[:, 2], lambda m: m.linear_acceleration.z)
    _check(messages["/beetle/barometer"], dictionary["barometer", "pressure"].value, lambda m: m.fluid_pressure)
    _check(
        messages["/beetle/compass"],
        dictionary["compass", "magnetic_field"].values[:, 1] * 1e-6,
        lambda m: m.magnetic_field.y,
    )
    _check(messages["/beetle/below"], dictionary["below", "range"].value, lambda m: m.range)
    _check(messages["/beetle/gps"], dictionary["gps", "position"].values[:, 2], lambda m: m.altitude)
    truth = next(series for series in run.samples if series.quantity == "mixing_ratio")
    _check(messages["/truth/beetle/nose/ethanol"], truth.value, lambda m: m.raw)
    # All around are walls.
    _, scan = messages["/beetle/scan"][-1]
    least = dictionary["scan", "least_range"].value[-1]
    assert min(scan.ranges) == pytest.approx(least, rel=1e-4)
    assert np.isfinite(np.array(scan.ranges)).all()
    assert len(scan.ranges) == 90
    _, grid = messages["/map"][0]
    assert (grid.info.width, grid.info.height) == run.environment.occupancy.shape[:2]
    assert {transform.child_frame_id for transform in messages["/tf_static"][0][1].transforms} >= {"beetle/nose"}


def _check(messages, values, pick):
    np.testing.assert_allclose([pick(message) for _, message in messages], values, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.extras
def test_mcap_is_read_back_by_another_reader(flown, tmp_path):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    folder = extracted(flown, "mcap", tmp_path)
    messages = {}
    with (folder / f"{flown.name}.mcap").open("rb") as file:
        for _, channel, message, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            messages.setdefault(channel.topic, []).append((message.log_time, decoded))
    checked(messages, gslcosim_data.open_run(flown))


@pytest.mark.slow
@pytest.mark.extras
def test_rosbag2_is_read_back(flown, tmp_path):
    from rosbags import highlevel

    folder = extracted(flown, "rosbag2", tmp_path)
    messages = {}
    with highlevel.AnyReader([folder]) as bag:
        for connection, stamp, data in bag.messages():
            messages.setdefault(connection.topic, []).append((stamp, bag.deserialize(data, connection.msgtype)))
    checked(messages, gslcosim_data.open_run(flown))
    # As `ros2 bag` looks at it.
    assert "storage_identifier: sqlite3" in (folder / "metadata.yaml").read_text()
    with sqlite3.connect(next(folder.glob("*.db3"))) as database:
        assert database.execute("select count(*) from messages").fetchone()[0] == sum(map(len, messages.values()))


LATCHED = {"/map", "/tf_static", "/sources", "/beetle/robot_description", "/beetle/waypoints"}


def _durability(text):
    """As rosbag2 of Humble reads a profile: numbers in YAML, all fields there."""
    (profile,) = yaml.safe_load(text)
    assert {type(profile[name]) for name in ("history", "depth", "reliability", "durability", "liveliness")} == {int}
    assert profile["deadline"] == profile["lifespan"] == profile["liveliness_lease_duration"]
    assert (profile["reliability"], profile["avoid_ros_namespace_conventions"]) == (1, False)
    return profile["durability"]


@pytest.mark.slow
@pytest.mark.extras
def test_bags_offer_what_is_latched_live_to_who_comes_late(flown, tmp_path):
    """RViz and tf2 get the map and static transforms of a bag that is played: transient local in all three places."""
    from mcap.reader import make_reader
    from rosbags.rosbag2 import Reader

    folder = extracted(flown, "rosbag2", tmp_path)
    information = yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    # Humble takes the profiles of this version, a text with numbers; from 9 on they are a list with words.
    assert information["version"] == 8
    offered = {
        each["topic_metadata"]["name"]: _durability(each["topic_metadata"]["offered_qos_profiles"])
        for each in information["topics_with_message_count"]
    }
    assert {topic for topic, durability in offered.items() if durability == 1} == LATCHED
    assert set(offered.values()) == {1, 2}
    with sqlite3.connect(next(folder.glob("*.db3"))) as database:
        rows = database.execute("select name, offered_qos_profiles from topics").fetchall()
    assert {name: _durability(text) for name, text in rows} == offered
    with Reader(folder) as bag:
        read = {each.topic: each.ext.offered_qos_profiles[0].durability for each in bag.connections}
    assert {topic for topic, durability in read.items() if durability.name == "TRANSIENT_LOCAL"} == LATCHED
    with (extracted(flown, "mcap", tmp_path) / f"{flown.name}.mcap").open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    assert {each.topic: _durability(each.metadata["offered_qos_profiles"]) for each in channels} == offered


@pytest.mark.slow
def test_the_program_of_the_page_runs(flown, capsys):
    run_blocks(flown, slice(1))
    assert "nose ('response_ohm',)" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.extras
def test_the_programs_with_pandas_and_xarray_run(flown, capsys):
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    names = run_blocks(flown, slice(None))
    assert len(names["readings"]) == len(gslcosim_data.open_run(flown).table("readings_beetle"))
    assert float(capsys.readouterr().out.split()[-1]) > 0


def run_blocks(flown, which):
    """Run programs of the page one after the other on a run, and return the names they defined."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[which]
    names = {"__name__": "__main__"}
    exec(compile("\n".join(blocks).replace('"RUN"', repr(str(flown))), str(PAGE), "exec"), names)
    return names


def test_a_folder_with_files_and_a_missing_run_are_reported(tmp_path, capsys):
    assert main(["extract", "none", "--to", "csv", "--runs-dir", str(tmp_path)]) == 2
    assert "none: expected a run's folder or the id of one run" in capsys.readouterr().err
    assert main(["extract", "--to", "xml"]) == 2


@pytest.mark.slow
def test_what_cannot_be_written_is_reported(flown, tmp_path, capsys, monkeypatch):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    assert main(["extract", str(flown), "--to", "mcap", "--out", str(tmp_path / "full")]) == 2
    assert "Choose a new or empty folder" in capsys.readouterr().err
    monkeypatch.setitem(__import__("sys").modules, "rosbags.typesys", None)
    from gslcosim_ros.types import ros_types

    ros_types.cache_clear()
    assert main(["extract", str(flown), "--to", "mcap", "--out", str(tmp_path / "new")]) == 2
    assert "Install it with: pip install gslcosim-ros" in capsys.readouterr().err
    assert isinstance(gslcosim_data.open_run(flown), RunData)
