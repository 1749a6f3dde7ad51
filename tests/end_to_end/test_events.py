"""Each bundled scenario with events: what happens, one digest however it is run, and the marks in its recording."""

import pytest
from real_runs import ROOT, fly, fly_here
from repeated_runs import forked
from rerun.chunk import RrdReader
from test_participants import with_program

from gslcosim_data import open_run

SCENARIOS = sorted((ROOT / "scenarios").glob("event_*.yaml"))
HAPPEN = {
    "event_source": ["source_rate", "source_starts", "source_stops", "source_moves", "source_starts"],
    "event_sensor": ["sensor_biased", "sensor_drifts", "sensor_sticks", "sensor_drops_out", "sensor_recovers"],
    "event_rotor": ["rotor_weakens"],
    "event_wind": ["wind_changes", "wind_changes", "wind_changes"],
    "event_door": ["door_opens"],
    "event_radio": ["radio_lost", "radio_returns", "radio_lost"],
}

WIND_SERIES = ("wind", "wind_speed")
# The tick after which the door moves.
MOVES = {"door_opens": 49, "door_closes": 99}


def test_there_is_a_scenario_for_each_kind():
    assert {path.stem for path in SCENARIOS} == set(HAPPEN)


@pytest.mark.parametrize(
    "path",
    [pytest.param(p, marks=pytest.mark.tour if p.stem == "event_door" else (), id=p.stem) for p in SCENARIOS],
)
def test_an_example_runs_with_one_digest_in_one_process_and_in_many(tmp_path, path):
    single = fly_here(path, tmp_path / "single", is_recorded=True)
    multi = fly(path, tmp_path / "multi")
    assert single.result["valid"], single.errors
    assert single.result["digest"] == multi.result["digest"]
    assert single.result["events"] == multi.result["events"]
    assert [event["what"] for event in single.result["events"]] == HAPPEN[path.stem]
    texts = texts_in(single.run_dir / "recording.rrd")
    for event in single.result["events"]:
        assert any(event["text"] in text for text in texts["/events"]), texts["/events"]
        if event["what"].startswith("source_"):
            assert any(event["text"] in text for text in texts["/sources/0/events"] + texts["/sources/1/events"])
        elif event["agent"]:
            assert any(event["text"] in text for text in texts[f"/markers/{event['agent']}"])
        elif event["what"].startswith("door_"):
            assert any(event["text"] in text for text in texts["/room/doors/gate/events"])


def test_without_its_events_a_scenario_is_another_run(tmp_path):
    path = ROOT / "scenarios" / "event_sensor.yaml"
    eventful = fly_here(path, tmp_path / "eventful")
    calm = fly_here(path, tmp_path / "calm", "--set", "events=[]")
    assert eventful.result["digest"] != calm.result["digest"]
    assert "events" not in calm.result


def test_the_source_is_found_behind_the_door_once_that_is_open(tmp_path):
    """Behind a closed one nobody comes to it, and nothing is smelt of it."""
    path = ROOT / "scenarios" / "event_door.yaml"
    opened = fly_here(path, tmp_path / "opened", "--set", "referee.stop.time_limit_s=40", is_recorded=True)
    closed = fly_here(
        path, tmp_path / "closed", "--set", "referee.stop.time_limit_s=40", "--set", "events=[]", is_recorded=True
    )
    (found,), (kept_out,) = opened.result["agents"], closed.result["agents"]
    assert found["success"]
    assert found["time_to_source_s"] > 10.0
    assert found["shortest_path_m"] == pytest.approx(3.66, abs=0.9)
    assert not kept_out["success"]
    assert kept_out["shortest_path_m"] is None
    assert peak_ppm(opened) > 1.0
    assert peak_ppm(closed) == 0.0


def test_doors_go_on_as_they_are_in_snapshots_and_replays(tmp_path):
    """From a snapshot with the door open, and from one with the door closed, the run has the digest of the whole.

    A program moves the door.
    """
    keeping = ("--set", "snapshots.every_s=8", "--set", "referee.stop.time_limit_s=24")
    when = "{{participant: model, value: state.tick, above: {}}}"
    moves = [f"{{what: {what}, door: gate, when: {when.format(tick)}}}" for what, tick in MOVES.items()]
    controlled = (*with_program("right")[:2], "--set", f"events=[{', '.join(moves)}]")
    flown = fly_here(ROOT / "scenarios" / "event_door.yaml", tmp_path / "flown", *keeping, *controlled)
    assert [(event["what"], event["tick"]) for event in flown.result["events"]] == [
        ("door_opens", 51),
        ("door_closes", 101),
    ]
    for at_s in (0, 9, 17):
        assert replay(flown.run_dir, tmp_path / f"from_{at_s}", *(("--from", str(at_s)) if at_s else ())) == 0


def test_a_fork_may_close_the_door_again_and_not_make_another_of_it(tmp_path):
    short = ("--set", "referee.stop.time_limit_s=16")
    flown = fly_here(ROOT / "scenarios" / "event_door.yaml", tmp_path / "flown", *short)
    fork = forked(flown.run_dir, tmp_path / "fork", 11, "--event", "{what: door_closes, at_s: 12, door: gate}")
    assert [event["what"] for event in fork.result["events"]] == ["door_opens", "door_closes"]
    assert fork.result["fork_of"]["divergence"] is None
    assert replay(fork.run_dir, tmp_path / "again") == 0
    refused = forked(flown.run_dir, tmp_path / "no", 11, "--set", "environment.doors[0].min_m=[3, 1.5, 0]")
    assert (refused.exit_code, refused.run_dir) == (2, None)
    assert "environment.doors" in refused.errors
    twice = forked(flown.run_dir, tmp_path / "no", 11, "--event", "{what: door_opens, at_s: 12, door: gate}")
    assert "expected an event of a door that is closed then" in twice.errors


def peak_ppm(flown):
    (series,) = [each for each in open_run(flown.run_dir).samples if each.quantity == "mixing_ratio"]
    return float(series.values.max())


def test_a_run_with_events_replays_to_the_bit(tmp_path):
    flown = fly_here(ROOT / "scenarios" / "event_source.yaml", tmp_path / "flown")
    assert replay(flown.run_dir, tmp_path / "again") == 0


def test_vehicles_and_noses_are_in_the_wind_that_an_event_brings(tmp_path):
    """The anemometers say so, until the scenario's own wind is back."""
    even = ("--set", "gas.turbulence.kind=none")
    flown = fly_here(ROOT / "scenarios" / "event_wind.yaml", tmp_path, *even, is_recorded=True)
    (series,) = [each for each in open_run(flown.run_dir).samples if (each.sensor, each.quantity) == WIND_SERIES]
    speeds = dict(zip(series.tick.tolist(), series.values[:, 0].tolist(), strict=True))
    assert speeds[20] == pytest.approx(0.5, abs=1e-6)
    assert speeds[50] == pytest.approx(0.25, abs=1e-6)
    assert speeds[150] == pytest.approx(0.5, abs=1e-6)


def replay(run_dir, runs_dir, *options):
    from gslcosim.cli.main import main

    return main(["replay", str(run_dir), "--runs-dir", str(runs_dir), *options])


def texts_in(recording):
    """Return the texts and labels of each entity."""
    texts = {}
    for chunk in RrdReader(recording).store().stream().to_chunks():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.endswith(("text", "labels")):
                rows = batch.column(name).to_pylist()
                found = [text for row in rows for text in row or [] if isinstance(text, str)]
                texts.setdefault(str(chunk.entity_path), []).extend(found)
    return texts
