"""What methods note of their state is drawn as lanes and curves; recordings without notes show nothing of it."""

import numpy as np
from recording_content import column, view_names
from scripted_flight import WAYPOINT_EVERY_TICKS, scenario

from gslcosim_services.recorder.blueprint import default_blueprint

N_TICKS = 2 * WAYPOINT_EVERY_TICKS + 5


def test_modes_are_written_when_they_change_and_numbers_each_time(record):
    path = record(n_ticks=N_TICKS, noters=("agent_0",))
    ticks, _, modes = column(path, "/notes/agent_0/mode", "StateChange:state")
    assert (ticks, [mode[0] for mode in modes]) == ([0, WAYPOINT_EVERY_TICKS], ["surging", "casting"])
    ticks, _, values = column(path, "/plots/notes/agent_0/entropy_bits", "Scalars:scalars")
    assert ticks == [0, WAYPOINT_EVERY_TICKS, 2 * WAYPOINT_EVERY_TICKS]
    np.testing.assert_allclose([value[0] for value in values], [4.0 - 0.01 * tick for tick in ticks])


def test_without_notes_there_is_nothing_of_them(record, rows_of):
    assert not [entity for entity in rows_of(record()) if "notes" in entity]


def test_only_a_run_with_notes_has_views_of_them(make_room):
    with_notes, without = (
        view_names(default_blueprint(scenario(), make_room(), has_notes=has_notes)) for has_notes in (True, False)
    )
    assert set(with_notes) - set(without) == {"Mode", "Notes"}
