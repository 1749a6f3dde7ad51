"""The recorder keeps all that it gets, up to the verdict."""

import itertools

import numpy as np
import pytest
from deadlines import PROCESS_S
from recording_content import column
from rerun.chunk import RrdReader
from scripted_flight import CLOUD_EVERY_TICKS, NOSE_AND_VANE, ON_BOARD, WAYPOINT_EVERY_TICKS, ScriptedFlight

from gslcosim.base.errors import RecordingError
from gslcosim.contract import keys
from gslcosim.contract.messages import RadioMessage, RadioTraffic, RadioTransmission
from gslcosim.contract.participant import Episode
from gslcosim_services.recorder import run_recording
from gslcosim_services.recorder.core import FLUSH_TICKS, RecorderCore
from gslcosim_services.recorder.rerun_cli import run_rerun
from gslcosim_services.recorder.rows.agents import TRACK_STRIP_TICKS
from gslcosim_services.recorder.rows.gas import MAX_FILAMENTS

EVERY_TICK = (
    "/vehicles/agent_0",
    "/plots/gas_ppm/agent_0/nose/ethanol",
    "/plots/response/agent_0/nose",
    "/plots/wind_m_s/agent_0/vane/true",
    "/plots/wind_m_s/agent_0/vane/measured",
    "/plots/distance_m/agent_0",
    "/plots/tracking_error_m/agent_0",
)


def test_every_port_of_the_run_is_read_and_none_written(make_room, tmp_path):
    flight = ScriptedFlight(n_agents=2)
    spec = RecorderCore(flight.scenario, make_room(), tmp_path / "recording.rrd").spec
    assert {read.port for read in spec.reads} == {
        *(keys.BODIES, keys.SAMPLES, keys.FILAMENTS, keys.SCORE, keys.VERDICT),
        *(key(f"agent_{i}") for key in (keys.observation, keys.command) for i in range(2)),
    }
    assert all(read.delay_ticks == 0 for read in spec.reads)
    assert spec.writes == ()


@pytest.mark.parametrize("n_ticks", [1, 40, FLUSH_TICKS, 2 * FLUSH_TICKS + 3])
def test_every_row_arrives_whatever_the_length(record, rows_of, n_ticks):
    rows = rows_of(record(n_ticks=n_ticks))
    assert {entity: rows[entity] for entity in EVERY_TICK} == dict.fromkeys(EVERY_TICK, n_ticks)
    n_clouds = -(-n_ticks // CLOUD_EVERY_TICKS)
    assert rows["/gas/filaments"] == n_clouds
    assert rows["/gas/slices/ethanol"] == n_clouds
    assert rows["/waypoints/agent_0"] == -(-n_ticks // WAYPOINT_EVERY_TICKS)
    assert rows["/tracks/agent_0"] == (-(-(n_ticks - 1) // TRACK_STRIP_TICKS) or -1)
    assert rows["/summary"] == 2


@pytest.mark.parametrize("n_taken", [1, 7])
def test_rows_are_the_same_however_many_ticks_are_taken_apart_together(record, tmp_path, monkeypatch, n_taken):
    asked = {
        "n_ticks": 100,
        "n_agents": 2,
        "sensors": (*NOSE_AND_VANE, *ON_BOARD),
        "believers": ("agent_0",),
        "contacts": [()] * 30 + [("crate",), ("crate", "wall")],
        "plans": [()] * 20 + [((1.0, 2.0, 1.0), (2.0, 2.0, 1.0)), ((2.0, 2.0, 1.0),)],
    }
    together = record(**asked).rename(tmp_path / "together.rrd")
    monkeypatch.setattr(run_recording, "BATCH_TICKS", n_taken)
    apart = record(**asked)
    compared = run_rerun(["rrd", "compare", "--unordered", together, apart], timeout_s=PROCESS_S)
    assert compared.returncode == 0, compared.stderr


def test_what_stands_still_is_drawn_once_for_all_times(record, rows_of):
    rows = rows_of(record())
    still = ("/room/outline", "/room/floor", "/sources/0/place", "/sources/0/success_radius", "/wind", "/map/scale")
    assert {entity: rows[entity] for entity in still} == dict.fromkeys(still, -1)
    assert rows["/vehicles/agent_0/rotors"] == -1


def test_no_wall_clock_is_in_the_file(record):
    for chunk in RrdReader(record()).store().stream().to_chunks():
        assert set(chunk.timeline_names) <= {"tick", "sim_time"}


def test_the_track_has_no_gaps(record):
    flight = ScriptedFlight(n_ticks=35)
    _, _, strips = column(record(n_ticks=35), "/tracks/agent_0", "LineStrips3D:strips")
    joined = [strips[0][0][0], *(point for row in strips for point in row[0][1:])]
    assert all(a[0][-1] == b[0][0] for a, b in itertools.pairwise(strips))
    np.testing.assert_allclose(joined, [flight.position_m(tick) for tick in range(35)], rtol=1e-6)


def test_a_planned_path_is_drawn_once_from_where_it_was_planned(record):
    bend, other, goal = (1.0, 0.0, 2.0), (2.0, 2.0, 2.0), (3.0, 0.0, 2.0)
    plans = ((), (bend, goal), (bend, goal), (goal,), (), (other, goal), (goal,), (goal, bend))
    path = record(n_ticks=12, plans=plans)
    ticks, _, strips = column(path, "/plans/agent_0", "LineStrips3D:strips")
    position_m = ScriptedFlight().position_m
    assert ticks == [1, 5, 7]
    expected = [[position_m(1), bend, goal], [position_m(5), other, goal], [position_m(7), goal, bend]]
    for (strip,), points_m in zip(strips, expected, strict=True):
        np.testing.assert_allclose(strip, points_m, rtol=1e-6)


@pytest.mark.parametrize("n_filaments", [0, 2 * MAX_FILAMENTS + 1])
def test_large_clouds_are_thinned_evenly_and_empty_ones_recorded(record, n_filaments):
    _, _, centres = column(record(n_ticks=1, n_filaments=n_filaments), "/gas/filaments", "GaussianSplats3D:centers")
    assert len(centres[0]) == -(-n_filaments // 3)


def test_nothing_is_recorded_after_the_verdict(make_room, rows_of, tmp_path):
    flight, path = ScriptedFlight(n_ticks=30), tmp_path / "recording.rrd"
    core = RecorderCore(flight.scenario, make_room(), path)
    core.reset(Episode(seed=0))
    for tick in range(60):
        core.step(tick, flight.inbox(tick))
    core.close()
    rows = rows_of(path)
    assert {entity: rows[entity] for entity in EVERY_TICK} == dict.fromkeys(EVERY_TICK, 30)
    assert rows["/gas/filaments"] == 3


def test_the_text_ends_with_the_result_and_the_log_with_the_end(record):
    path = record(n_ticks=40)
    ticks, _, texts = column(path, "/summary", "TextDocument:text")
    assert ticks == [0, 39]
    assert "Success after 3.9 s" not in texts[0][0]
    assert "Success after 3.9 s" in texts[1][0]
    assert "27.0 m flown (shortest way 12.0 m)" in texts[1][0]
    ticks, _, lines = column(path, "/events", "TextLog:text")
    assert list(zip(ticks, (line[0] for line in lines), strict=True)) == [
        (3, "agent_0: takes off"),
        (39, "the run ends after 3.9 s: success"),
    ]


def test_a_run_that_ends_without_verdict_is_recorded_to_its_end(record, rows_of):
    rows = rows_of(record(n_ticks=100, until=45))
    assert rows["/vehicles/agent_0"] == 45
    assert rows["/tracks/agent_0"] == -(-44 // TRACK_STRIP_TICKS)
    assert rows["/summary"] == 1


def test_changing_wind_has_a_row_at_each_change(record, rows_of, make_room):
    """Frames change each second; the plume is 150 s old at tick 0, which is frame 0 of two."""
    room = make_room(wind_m_s=((0.3, 0.0, 0.0), (0.0, 0.3, 0.0)))
    path = record(n_ticks=35, room=room)
    ticks, _, vectors = column(path, "/wind", "Arrows3D:vectors")
    assert ticks == [0, 10, 20, 30]
    assert vectors[0][0][0] > 0.0 == vectors[1][0][0]
    assert vectors[0] == vectors[2]
    assert rows_of(path)["/wind"] == 4


def test_equal_runs_give_equal_content_and_others_do_not(record):
    first, second = record(run_id="first"), record(run_id="second")
    other = record(run_id="other", n_ticks=41)
    assert run_rerun(["rrd", "compare", "--unordered", first, second], timeout_s=PROCESS_S).returncode == 0
    assert run_rerun(["rrd", "compare", "--unordered", first, other], timeout_s=PROCESS_S).returncode != 0


def test_the_recording_is_known_by_the_runs_id(record):
    path = record(run_id="warehouse-seed7")
    assert [entry.recording_id for entry in RrdReader(path).recordings()] == ["warehouse-seed7"]
    assert len(RrdReader(path).blueprints()) == 1


def test_closing_twice_or_before_the_start_does_nothing(make_room, tmp_path):
    path = tmp_path / "recording.rrd"
    core = RecorderCore(ScriptedFlight().scenario, make_room(), path)
    core.close()
    assert not path.exists()
    core.reset(Episode(seed=0))
    core.close()
    content = path.read_bytes()
    core.close()
    assert path.read_bytes() == content


def test_a_reset_starts_the_file_again(make_room, rows_of, tmp_path):
    flight, path = ScriptedFlight(), tmp_path / "recording.rrd"
    core = RecorderCore(flight.scenario, make_room(), path)
    for n_ticks in (25, 12):
        core.reset(Episode(seed=0))
        for tick in range(n_ticks):
            core.step(tick, flight.inbox(tick))
    core.close()
    assert rows_of(path)["/vehicles/agent_0"] == 12


def test_a_file_that_cannot_be_written_is_named(make_room, tmp_path):
    (tmp_path / "taken").write_text("a file where the folder should be")
    path = tmp_path / "taken" / "recording.rrd"
    core = RecorderCore(ScriptedFlight().scenario, make_room(), path)
    with pytest.raises(RecordingError, match=r"taken/recording\.rrd"):
        core.reset(Episode(seed=0))


def test_rerun_switched_off_is_an_error_instead_of_an_empty_file(make_room, tmp_path, monkeypatch):
    monkeypatch.setenv("RERUN", "off")
    core = RecorderCore(ScriptedFlight().scenario, make_room(), tmp_path / "recording.rrd")
    with pytest.raises(RecordingError, match="environment variable RERUN"):
        core.reset(Episode(seed=0))


def test_the_radio_has_a_log_that_shows_what_became_of_each_text(record):
    message = RadioMessage(channel="radio", text="here")
    sent = RadioTransmission(sender="agent_0", message=message, reached=("agent_1",))
    lost = RadioTransmission(sender="agent_1", message=message, lost=("agent_0",))
    refused = RadioTransmission(sender="agent_1", message=message, refusal="outgoing[0].text: too long.")

    def transmit(inbox):
        tick = inbox[keys.BODIES].tick
        return {**inbox, keys.RADIO: RadioTraffic(tick=tick, transmissions=(sent, lost, refused) if tick == 2 else ())}

    path = record(n_ticks=3, n_agents=2, channels=({"name": "radio"},), edit=transmit)
    ticks, _, texts = column(path, "/radio", "TextLog:text")
    assert ticks == [2, 2, 2]
    assert [text[0] for text in texts] == [
        "agent_0 on radio to all: here   [heard by agent_1]",
        "agent_1 on radio to all: here   [lost for agent_0]",
        "agent_1 on radio to all: here   [refused: outgoing[0].text: too long.]",
    ]
