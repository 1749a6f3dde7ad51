"""Recordings that open at a time, or are moved to a common first contact with gas."""

import numpy as np
import pytest
from scripted_flight import ScriptedFlight

from gslcosim.base.errors import RecordingError
from gslcosim.contract import keys
from gslcosim.contract.messages import RefereeEvent
from gslcosim_data.derived_recordings import RecordedRun, record_from_tick, record_side_by_side
from gslcosim_data.recording_reader import RecordingReader

N_TICKS = 60


@pytest.fixture
def record_contact(record):
    """Record a run whose nose first meets gas at a tick, if at any."""

    def run(name, contact_tick=None):
        def meet_gas(inbox):
            score = inbox[keys.SCORE]
            if score.tick != contact_tick:
                return inbox
            event = RefereeEvent(agent="agent_0", kind="gas_contact", text="first contact")
            return {**inbox, keys.SCORE: score.model_copy(update={"events": (event,)})}

        path = record(run_id=name, n_ticks=N_TICKS, edit=meet_gas)
        return RecordedRun(recording=path, scenario=ScriptedFlight(n_ticks=N_TICKS).scenario, text="")

    return run


def test_a_picture_at_a_time_knows_nothing_of_what_comes_later(record_contact, make_room, tmp_path):
    run = record_contact("run")
    for is_still, last_tick in ((True, 25), (False, N_TICKS - 1)):
        path = tmp_path / f"at_{is_still}.rrd"
        record_from_tick(run.recording, run.scenario, make_room(), path, tick=25, is_still=is_still)
        rows = RecordingReader(path)
        assert rows.column("vehicles/agent_0", "Transform3D:translation").tick[-1] == last_tick
        assert rows.column("plots/distance_m/agent_0", "Scalars:scalars").tick[-1] == last_tick
        assert rows.still("legend", "TextDocument:text")[0].startswith("- **cloud**")


def test_a_time_after_the_end_is_refused(record_contact, make_room, tmp_path):
    run = record_contact("run")
    with pytest.raises(RecordingError, match=r"--at: expected a time within .* ends at 5\.9 s, was 10 s"):
        record_from_tick(run.recording, run.scenario, make_room(), tmp_path / "at.rrd", tick=100, is_still=True)


def test_runs_are_moved_to_one_first_contact(record_contact, make_room, tmp_path):
    runs = [record_contact("a", contact_tick=40), record_contact("b", contact_tick=10)]
    path = tmp_path / "both.rrd"
    record_side_by_side(runs, make_room(), path, is_by_contact=True)
    rows = RecordingReader(path)
    contacts = {}
    for entity in rows.below("markers"):
        labels = rows.column(entity, "Points3D:labels")
        contacts[entity] = [
            int(tick) for tick, text in zip(labels.tick, labels.values, strict=True) if text == "first gas"
        ]
    assert sorted(contacts.values()) == [[40], [40]]
    ticks = [
        rows.column(entity, "Transform3D:translation").tick
        for entity in rows.below("vehicles")
        if entity.count("/") == 1
    ]
    assert sorted((int(t[0]), int(t[-1])) for t in ticks) == [(0, N_TICKS - 1), (30, N_TICKS + 29)]
    assert all(np.all(np.diff(t) == 1) for t in ticks)


def test_a_run_without_contact_is_named(record_contact, make_room, tmp_path):
    runs = [record_contact("a", contact_tick=40), record_contact("b")]
    with pytest.raises(RecordingError, match=r"--align first_contact: .* b has none"):
        record_side_by_side(runs, make_room(), tmp_path / "both.rrd", is_by_contact=True)
