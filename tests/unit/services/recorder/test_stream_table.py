"""The table of streams: each is found by its name and place, and older recordings are read by it too."""

from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
import rerun.blueprint as rrb
from scripted_flight import ScriptedFlight

from gslcosim_data import streams
from gslcosim_data.recording_reader import RecordingReader
from gslcosim_services.recorder.entities import build_entities
from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.stream_table import (
    ON_BOARD_STREAMS,
    STREAMS,
    TABLES,
    TRUE_WIND_SPEED,
    WIND_SPEED,
    split_values,
)


def test_no_two_streams_share_a_column_of_the_recording_or_a_name_in_a_table():
    for key in (lambda s: (s.entity, s.component), lambda s: (s.table or s.entity, s.name)):
        assert [found for found, n in Counter(map(key, STREAMS)).items() if n > 1] == []


def test_tables_hold_streams_and_streams_say_what_they_are():
    assert {stream.table for stream in STREAMS if stream.table} == set(TABLES)
    for stream in STREAMS:
        assert stream.meaning
        assert stream.writer
        assert (stream.unit == "m") <= bool(stream.frame or stream.table), f"{stream.name}: places are in a frame"


def test_readings_are_shared_out_among_streams_in_turn():
    pose = split_values(ON_BOARD_STREAMS["pose"])
    assert [list(range(10))[part] for part in pose] == [[0, 1, 2], [3, 4, 5, 6], [7, 8, 9]]
    assert split_values(()) == []


def test_recordings_of_older_versions_have_the_wind_as_bytes(tmp_path: Path):
    scenario = ScriptedFlight(n_ticks=4).scenario
    (names,) = build_entities(scenario)
    path, ticks = tmp_path / "run" / "recording.rrd", [0, 1, 2]
    file = RecordingFile(path, run_id="old", name="old", tick_ns=scenario.tick_ns, blueprint=rrb.Blueprint())
    winds = np.arange(9.0).reshape(3, 3)
    measured = np.array([[1.0, 0.1], [2.0, 0.2], [3.0, 0.3]])
    for stream, numbers in ((TRUE_WIND_SPEED, winds), (WIND_SPEED, measured)):
        column = pa.array([row.astype("<f4").tobytes() for row in numbers], type=pa.binary())
        curve = rr.Scalars.columns(scalars=np.linalg.norm(numbers, axis=1))
        file.send(names.at(stream, sensor="vane"), ticks, [*curve, *rr.AnyValues.columns(numbers=column)])
    file.close()
    rows = RecordingReader(path)
    _, vector = streams.read_samples(rows, scenario, names)
    assert (vector.quantity, vector.columns) == ("wind", ("wind_x_m_s", "wind_y_m_s", "wind_z_m_s"))
    np.testing.assert_allclose(vector.values, winds)
    _, wind_from = streams.read_readings(rows, scenario, names)
    assert (wind_from.quantity, wind_from.columns, wind_from.unit) == ("wind_from", ("wind_from_rad",), "rad")
    assert wind_from.value == pytest.approx([0.1, 0.2, 0.3])
