"""Tables of robot logs: every reading is the right one, or left out by name, or the table is refused by line."""

import math

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim_data.log_tables import read_csv_log
from gslcosim_data.log_values import LoggedSensor

NOSE = LoggedSensor(name="nose", parts=("ohm",))
ESTIMATE = LoggedSensor(name="nose_ppm", parts=("ppm",), is_estimate=True)
PID = LoggedSensor(name="pid", parts=("ppm",))
WIND = LoggedSensor(name="wind", parts=("m/s", "rad"))
SONIC = LoggedSensor(name="sonic", parts=("m/s",) * 3)
POSE = "time_s,x_m,y_m,z_m"


def read(tmp_path, text, *sensors, encoding="utf-8"):
    (tmp_path / "log.csv").write_bytes(text.encode(encoding))
    return read_csv_log(tmp_path / "log.csv", sensors)


def table(columns, *cells):
    """Return a table of a vehicle that is at x = 0, 1, … m at 0, 1, … s, with further columns."""
    return "\n".join([f"{POSE},{columns}", *(f"{i},{i},2,1,{row}" for i, row in enumerate(cells))]) + "\n"


def values_of(log, name):
    return log.instruments[name].values.tolist()


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        (table("nose_ohm", "48000.5", "47000"), "utf-8-sig"),
        (table("nose_ohm", "48000.5", "47000"), "utf-16"),
        (table("nose_ohm", "48000.5", "47000").replace("\n", "\r\n"), "utf-8"),
        (table("nose_ohm", "48000.5", "47000").replace(",", ";"), "utf-8"),
        (table("nose_ohm", "48000.5", "47000").replace(",", ";").replace(".", ","), "utf-8"),
        (table("nose_ohm", "48000.5", "47000").replace(",", "\t"), "utf-8"),
        ("# München\n\n" + table("nose_ohm", "48000.5", "47000").replace("\n1,", "\n\n# a pause\n1,"), "latin-1"),
        (table("nose_ohm", "48000.5", "47000").replace(",", " , "), "utf-8"),
        (table("nose_ohm", "48000.5,", "47000,").replace("nose_ohm", "nose_ohm,"), "utf-8"),
        (table("Nose_Ohm", "48000.5", "47000").replace("time_s", "Time_S"), "utf-8"),
        (table("nose_kohm", "48.0005", "47"), "utf-8"),
        (table("nose_kΩ", "48.0005", "47"), "utf-8"),
        (table("nose", "48000.5", "47000"), "utf-8"),
    ],
)
def test_spellings_of_one_table_are_read_alike(tmp_path, text, encoding):
    log = read(tmp_path, text, NOSE, encoding=encoding)
    np.testing.assert_allclose(values_of(log, "nose"), [[48000.5], [47000]])
    np.testing.assert_allclose(log.position_world_m, [[0, 2, 1], [1, 2, 1]])


@pytest.mark.parametrize(
    ("columns", "cells", "name", "expected"),
    [
        ("mox_b_ohm,mox_ohm", "21000,48000", "mox", 48000),
        ("mox_b_ohm,mox_ohm", "21000,48000", "mox_b", 21000),
        ("mox_ohm,mox_b_ohm", "48000,21000", "mox", 48000),
        ("mox2_ohm,mox_ohm", "21000,48000", "mox", 48000),
        ("b_mox_ohm,mox_ohm", "21000,48000", "mox", 48000),
        ("mox_temperature_c,mox_ohm", "23,48000", "mox", 48000),
        ("mox_adc_mv,mox_ohm", "900,48000", "mox", 48000),
        ("mox_status,mox_ohm", "1,48000", "mox", 48000),
        ("mox_baseline_ohm,mox_ohm", "50000,48000", "mox", 48000),
    ],
)
def test_a_sensor_reads_no_column_of_another(tmp_path, columns, cells, name, expected):
    sensors = [LoggedSensor(name=name, parts=("ohm",)) for name in ("mox", "mox_b")]
    assert values_of(read(tmp_path, table(columns, cells, cells), *sensors), name)[0] == [expected]


def test_an_estimate_is_no_reading_of_its_sensor(tmp_path):
    log = read(tmp_path, table("nose_ppm,nose_ohm", "3,48000", "4,47000"), NOSE, ESTIMATE)
    assert values_of(log, "nose") == [[48000], [47000]]
    assert values_of(log, "nose_ppm") == [[3], [4]]


@pytest.mark.parametrize(
    ("sensor", "columns", "cells", "expected"),
    [
        (WIND, "wind_speed_m_s,wind_from_rad", "0.5,3", [0.5, 3]),
        (WIND, "wind_from_rad,wind_speed_m_s", "3,0.5", [0.5, 3]),
        (WIND, "wind_direction,wind_speed", "3,0.5", [0.5, 3]),
        (WIND, "wind_from_deg,wind_speed_km_h", "180,3.6", [1, math.pi]),
        (WIND, "wind_a,wind_b", "0.5,3", [0.5, 3]),
        (SONIC, "sonic_z_m_s,sonic_x_m_s,sonic_y_m_s", "3,1,2", [1, 2, 3]),
        (SONIC, "sonic_u,sonic_v,sonic_w", "1,2,3", [1, 2, 3]),
        (SONIC, "sonic_w,sonic_v,sonic_u", "3,2,1", [1, 2, 3]),
        (PID, "pid_ppb", "500", [0.5]),
    ],
)
def test_parts_of_a_reading_are_known_by_unit_and_letter(tmp_path, sensor, columns, cells, expected):
    log = read(tmp_path, table(columns, cells, cells), sensor)
    np.testing.assert_allclose(log.instruments[sensor.name].values[0], expected)


def test_times_places_and_yaw_are_converted(tmp_path):
    text = "time_ms,x_cm,y_mm,z_m,yaw_deg\n1000,100,2000,1,90\n2000,200,2000,1,\n"
    log = read(tmp_path, text)
    np.testing.assert_allclose(log.time_s, [1, 2])
    np.testing.assert_allclose(log.position_world_m, [[1, 2, 1], [2, 2, 1]])
    np.testing.assert_allclose(log.quaternion_wxyz, [[math.sqrt(0.5), 0, 0, math.sqrt(0.5)]] * 2)


@pytest.mark.parametrize("fill", ["-9999", "-999", "-1", "inf", "-inf", "1e300", "9.96921e36", "0"])
def test_values_that_stand_for_none_are_left_out_and_named(tmp_path, fill):
    log = read(tmp_path, table("nose_ohm", "48000", fill, "47000"), NOSE)
    assert values_of(log, "nose") == [[48000], [47000]]
    assert log.instruments["nose"].time_s.tolist() == [0, 2]
    (remark,) = log.remarks
    assert remark.startswith("nose_ohm: 1 of 3 values are left out")
    assert "in line 3" in remark


@pytest.mark.parametrize("blank", ["", "nan", "NaN", "NA", "null", "None", "--"])
def test_blank_cells_are_no_readings(tmp_path, blank):
    log = read(tmp_path, table("nose_ohm", "48000", blank, "47000"), NOSE)
    assert values_of(log, "nose") == [[48000], [47000]]
    assert log.remarks == ()


@pytest.mark.parametrize(
    ("cells", "n_left"), [(("0.5", "-1", "3"), 2), (("-0.4", "-1", "3"), 3), (("-9999", "2", "3"), 2)]
)
def test_a_small_mixing_ratio_below_0_is_kept_beside_others(tmp_path, cells, n_left):
    assert len(values_of(read(tmp_path, table("pid_ppm", *cells), PID), "pid")) == n_left


def test_degrees_under_the_name_of_radians_are_named(tmp_path):
    log = read(tmp_path, table("wind_speed_m_s,wind_from_rad", "0.5,270", "0.5,1"), WIND)
    assert values_of(log, "wind") == [[0.5, 1]]
    assert "wind_from_rad: 1 of 2 values are left out" in log.remarks[0]


def test_a_place_that_is_none_is_left_out(tmp_path):
    text = f"{POSE}\n0,0,2,1\n1,-9999,2,1\n2,2,2,1\n"
    log = read(tmp_path, text)
    assert log.time_s.tolist() == [0, 2]
    assert "x_m: 1 of 3 values are left out" in log.remarks[0]


@pytest.mark.parametrize(
    ("columns", "sensors", "remark"),
    [
        ("nose_ohm", (NOSE, PID), "pid: expected a column that begins with pid_, found none among time_s"),
        ("noze_ohm", (NOSE,), "nose: expected a column that begins with nose_, found none among time_s"),
        ("nose_ohm", (NOSE, ESTIMATE), None),
        ("nose_raw", (NOSE,), "nose: read from nose_raw, in ohm."),
        ("nose_left_ohm", (NOSE,), "nose: read from nose_left_ohm, in ohm."),
    ],
)
def test_what_is_not_read_or_is_assumed_is_named(tmp_path, columns, sensors, remark):
    remarks = read(tmp_path, table(columns, "48000", "47000"), *sensors).remarks
    assert [text.startswith(remark) for text in remarks] == [True] if remark else not remarks


GOOD = table("nose_ohm", "48000", "47000")


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (GOOD + GOOD, "line 4: expected numbers, found the names of the columns again: the log was restarted there"),
        (GOOD + table("x,nose_ohm", "1,48000").replace("x_m,", ""), "line 4: expected numbers, found the names"),
        (GOOD + "0,0,2,1,48000\n", "line 4: expected times that ascend, 0 s follows 1 s"),
        (GOOD + "2,2,2", "line 4: expected 5 values, found 3; the log was cut off there. Delete the line"),
        (GOOD.replace("1,1,2,1", "1,1,2"), "line 3: expected 5 values, found 4; the log was cut off"),
        (GOOD.replace("0,0,2,1", "0,0,2") + "2,2,2,1,4\n", "line 2: expected 5 values, found 4; they stand"),
        (GOOD.replace("1,1,2", "1,5,1,5,2"), "line 3: expected 5 values, found 7"),
        (GOOD + "2,2,2,1,4800O\n", "line 4: nose_ohm: expected a number, was '4800O'"),
        (GOOD + "2026-05-01T12:00:00,2,2,1,48000\n", "line 4: time_s: expected a number, was '2026"),
        (GOOD + ",2,2,1,48000\n", "line 4: expected a time, found none"),
        (GOOD + "1,7,2,1,48000\n", "line 4: expected one place at 1 s, found another, 6.0 m away"),
        (GOOD + "2,2,2,1,48\0\n", "line 4: expected comma-separated values, line contains NUL"),
        (table("nose_ohm,nose_ohm", "1,2"), "line 1: nose_ohm: expected one column of that name, found 2"),
        (table("nose_mv", "900"), "nose: expected ohm, found nose_mv"),
        (table("nose_ppm", "900"), "nose: expected ohm, found nose_ppm"),
        (table("nose_1_ohm,nose_2_ohm", "1,2"), "expected 1 column that begins with nose_, found nose_1_ohm, nose_2"),
        (GOOD.replace(",", ";").replace("48000", "48,5").replace("47000", "4.5"), "commas in line 2, points in line 3"),
        (GOOD.replace("z_m", "z"), "expected columns time_s, x_m, y_m, z_m, lacks z_m"),
        (GOOD.replace("time_s", "stamp"), "lacks time_s"),
        (table("time_ns,nose_ohm", "0,1"), "expected one column time_s, found time_s, time_ns"),
        (table("quaternion_w,quaternion_z", "1,0"), "lacks quaternion_x, quaternion_y"),
        ("\n\n", "lacks time_s, x_m, y_m, z_m. It has none"),
    ],
)  # fmt: skip
def test_tables_that_are_wrong_are_refused_by_line(tmp_path, text, error):
    with pytest.raises(UsageError) as raised:
        read(tmp_path, text, NOSE)
    assert error in str(raised.value)
    assert str(tmp_path / "log.csv") in str(raised.value)


def test_a_last_line_without_an_end_is_named(tmp_path):
    log = read(tmp_path, GOOD.rstrip(), NOSE)
    assert log.remarks == ("line 3: the last line has no end; if the log was cut off there, delete the line.",)
