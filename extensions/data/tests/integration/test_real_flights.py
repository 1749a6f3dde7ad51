"""Logs of runs from elsewhere become runs: what was logged is what is read back, and the referee judges it."""

import json
import math

import numpy as np
import pytest

import gslcosim_data
from gslcosim.cli.main import main

HEAD = "time_s,x_m,y_m,z_m,yaw_rad,nose_ohm,wind_speed_m_s,wind_from_rad"


def written(tmp_path, *, rows=None, head=HEAD):
    """Write a log that flies along y = 2 m towards the source of the small room, which is at (1.5, 2, 1)."""
    if rows is None:
        rows = [
            f"{100 + 0.25 * i},{4.5 - 0.1 * i},2,1,{math.pi},{50000 - 100 * i},{0.5 if i % 2 else ''},3.1"
            for i in range(41)
        ]
        rows = [row if i % 2 else row.rsplit(",", 1)[0] + "," for i, row in enumerate(rows)]
    (tmp_path / "log.csv").write_text("\n".join([head, *rows]) + "\n")
    return tmp_path / "log.csv"


def imported(capsys, tmp_path, log, *words):
    call = ["runs", "import", str(log), "--scenario", "tiny_room", "--runs-dir", str(tmp_path / "runs"), "--json"]
    exit_code = main([*call, *words])
    printed = capsys.readouterr()
    assert exit_code == 0, printed.err
    result = json.loads(printed.out)
    return result, gslcosim_data.open_run(tmp_path / "runs" / result["run_id"])


@pytest.mark.slow
@pytest.mark.tour
def test_a_log_is_judged_and_read_back_as_it_was(tmp_path, capsys):
    """At 0.4 m/s it comes within 0.8 m of the source after 2.2 m, which is 5.5 s."""
    result, run = imported(capsys, tmp_path, written(tmp_path))
    (agent,) = result["agents"]
    assert (result["valid"], result["end_reason"], agent["success"]) == (True, "success", True)
    assert agent["time_to_source_s"] == pytest.approx(5.5, abs=0.11)
    assert agent["path_length_m"] == pytest.approx(2.2, abs=0.05)
    assert agent["final_distance_m"] == pytest.approx(0.8, abs=0.05)
    track = run.tracks["beetle"]
    np.testing.assert_allclose(track.position_world_m[:, 0], 4.5 - 0.4 * track.time_s, atol=1e-5)
    call_import = {(one.sensor, one.quantity): one for one in run.readings}
    nose = call_import["nose", "response"]
    np.testing.assert_allclose(nose.value, 50000 - 100 * np.floor(nose.time_s / 0.25 + 1e-6))
    wind = call_import["wind", "wind_speed"]
    assert wind.time_s[0] == pytest.approx(0.3), "the first with a number is at 0.25 s"
    np.testing.assert_allclose(wind.value, 0.5)
    assert not len(run.filaments.tick)
    assert run.samples == ()
    assert run.manifest["imported_from"]["file"] == "log.csv"


@pytest.mark.slow
def test_the_same_log_has_the_same_digest_and_cannot_be_repeated(tmp_path, capsys):
    log = written(tmp_path)
    (first, run), (second, _) = imported(capsys, tmp_path, log), imported(capsys, tmp_path, log)
    assert first["digest"] == second["digest"]
    for words in (["replay", str(run.folder)], ["fork", str(run.folder), "--at", "2"]):
        assert main([*words, "--runs-dir", str(tmp_path / "again")]) == 2
        assert "was a flight from elsewhere that was imported" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("to", ["rosbag2", "mcap"])
@pytest.mark.extras
def test_a_bag_of_a_run_comes_back_as_a_run(tmp_path, capsys, to):
    words = ["up", "tiny_room", "--in-process", "--quiet", "--runs-dir", str(tmp_path / "flown")]
    main([*words, "--set", "referee.stop.time_limit_s=8"])
    flown = gslcosim_data.open_run(next((tmp_path / "flown").iterdir()))
    main(["extract", str(flown.folder), "--to", to, "--out", str(tmp_path / "bag")])
    capsys.readouterr()
    log = tmp_path / "bag" if to == "rosbag2" else next((tmp_path / "bag").iterdir())
    result, run = imported(capsys, tmp_path, log)
    assert result["end_reason"] == flown.result["end_reason"]
    np.testing.assert_allclose(
        run.tracks["beetle"].position_world_m, flown.tracks["beetle"].position_world_m, atol=1e-5
    )
    for one, other in zip(run.readings, flown.readings, strict=True):
        assert (one.sensor, one.columns) == (other.sensor, other.columns)
        np.testing.assert_allclose(one.values, other.values, rtol=1e-6)
    assert main(["runs", "import", str(log), "--scenario", "tiny_room", "--pose", "/odom"]) == 2
    assert "--pose /odom: expected one of /beetle/odom, /beetle/pose" in capsys.readouterr().err
    assert main(["runs", "import", str(log), "--scenario", "tiny_room", "--topic", "nose=/x"]) == 2
    assert "--topic nose=/x: expected one of /beetle/nose" in capsys.readouterr().err


SCENARIO = """schema: gslcosim/scenario/1
name: hall
environment: {layout: {kind: warehouse_empty, size_m: [12, 12, 3], seed: 1}}
wind: {solver: uniform, inlet_velocity_m_s: [0.3, 0, 0], cell_m: 0.5}
gas: {sources: [{position_m: [10, 10, 1], filaments_per_s: 5}]}
agents:
  - name: rover
    start: %s
    vehicle: {model: crazyflie, start_m: [99, 4, 0.2], search_height_m: 1}
    sensors: [{model: tgs2600, name: nose}, {model: pid, name: pid}]
participants: [{name: hvac, start: {command: [no_such_program]}, writes: [source_0]}]
"""


@pytest.mark.slow
@pytest.mark.parametrize("start", ["{python: dung_beetle}", "{python: no_such_file.py}", "{command: [./none, -v]}"])
def test_neither_method_nor_programs_nor_start_matter_and_remarks_are_kept(tmp_path, capsys, start):
    """The method would need an anemometer; the other programs do not exist, and the start is outside the room."""
    (tmp_path / "hall.yaml").write_text(SCENARIO % start)
    (tmp_path / "log.csv").write_text("time_s,x_m,y_m,z_m,nose_ohm\n0,4,4,1,-1\n20,5,4,1,48100\n21,70,4,1,48200\n")
    words = ["runs", "import", str(tmp_path / "log.csv"), "--scenario", str(tmp_path / "hall.yaml"), "--json"]
    assert main([*words, "--runs-dir", str(tmp_path / "runs")]) == 0
    printed = capsys.readouterr()
    run = gslcosim_data.open_run(tmp_path / "runs" / json.loads(printed.out)["run_id"])
    remarks = run.manifest["imported_from"]["remarks"]
    assert printed.err == "".join(f"{tmp_path / 'log.csv'}: {text}\n" for text in remarks)
    for remark in (
        "nose_ohm: 1 of 3 values are left out", "pid: expected a column that begins with pid_",
        "no pose in the 20.0 s after 0 s", "1 of 2 steps between poses are jumps; the first is 65.0 m in 1 s",
        "1 of 3 poses are outside the room; the first is (70.00, 4.00, 1.00) m at 21 s",
    ):  # fmt: skip
        assert any(text.startswith(remark) for text in remarks)
    assert len(remarks) == 5
    assert run.tracks["rover"].position_world_m[0].tolist() == [4, 4, 1]


@pytest.mark.slow
def test_readings_that_no_tick_has_are_named(tmp_path, capsys):
    """50 readings in each of two seconds at 10 ticks per second, and ten more when the pose has ended."""
    rows = [f"{0.02 * i:.2f},{4 + 0.01 * i:.2f},2,1,{50000 - i}" for i in range(101)]
    rows += [f"{5 + i},,,,40000" for i in range(10)]
    log = written(tmp_path, head="time_s,x_m,y_m,z_m,nose_ohm", rows=rows)
    _, run = imported(capsys, tmp_path, log, "--set", "agents[0].sensors=[{model: tgs2600, name: nose}]")
    assert run.manifest["imported_from"]["remarks"] == [
        "nose: 10 of 111 readings are before the first pose or after the last, and are left out.",
        "nose: 111 readings in 31 ticks; the last of each tick is kept. A smaller tick_ms than 100 keeps more.",
    ]
    rows = [f"{0.1 * i:.1f},{4 + 0.01 * i:.2f},2,1,{50000 - i}" for i in range(41)]
    log = written(tmp_path, head="time_s,x_m,y_m,z_m,nose_ohm", rows=rows)
    _, run = imported(capsys, tmp_path, log, "--set", "agents[0].sensors=[{model: tgs2600, name: nose}]")
    assert run.manifest["imported_from"]["remarks"] == []


@pytest.mark.parametrize(
    ("head", "rows", "call_import"),
    [
        ("time_s,x_m,y_m,z_m", ["0,1,2,1"], "expected poses at two times or more, was 1"),
        (
            "time_s,x_m,y_m,z_m",
            ["0,1,2,1", "1.7e9,1,2,1"],
            "expected poses at most 3600 s apart, 1.7e+09 s follows 0 s",
        ),
        (
            "time_s,x_m,y_m,z_m,quaternion_w,quaternion_x,quaternion_y,quaternion_z",
            ["0,1,2,1,0,0,0,0", "1,1,2,1,1,0,0,0"],
            "expected attitudes, was 0, 0, 0, 0 somewhere",
        ),
    ],
)
def test_logs_that_are_none_are_refused(tmp_path, capsys, head, rows, call_import):
    log = written(tmp_path, head=head, rows=rows)
    assert main(["runs", "import", str(log), "--scenario", "tiny_room", "--runs-dir", str(tmp_path / "runs")]) == 2
    assert call_import in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


def test_wrong_calls_are_reported(tmp_path, capsys):
    def call_import(*words):
        assert main(["runs", "import", *map(str, words)]) == 2
        return capsys.readouterr().err

    assert "expected a log, found none" in call_import(tmp_path / "none.csv", "--scenario", "tiny_room")
    log = written(tmp_path)
    assert "--scenario: expected one agent, was 3 in swarm_tiny" in call_import(log, "--scenario", "swarm_tiny")
    assert "expected a bag of ROS, was log.csv" in call_import(log, "--scenario", "tiny_room", "--pose", "/odom")
