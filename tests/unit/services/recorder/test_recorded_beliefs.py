"""Beliefs are drawn over the map, and how good they are over time; recordings without them show nothing of it."""

import numpy as np
from recording_content import column, view_names
from scripted_flight import WAYPOINT_EVERY_TICKS, belief_of, scenario

from gslcosim_services.recorder.blueprint import default_blueprint
from gslcosim_services.recorder.colors import belief_colors
from gslcosim_services.recorder.rerun_cli import is_complete
from gslcosim_services.recorder.rows.agents import sum_over_height

N_TICKS = 2 * WAYPOINT_EVERY_TICKS + 5


def test_every_belief_is_drawn_once_with_its_place(record, rows_of):
    path = record(n_ticks=N_TICKS, believers=("agent_0",))
    assert is_complete(path)
    assert rows_of(path)["/beliefs/agent_0"] == 3
    ticks, _, pictures = column(path, "/beliefs/agent_0", "GridMap:data")
    assert ticks == [0, WAYPOINT_EVERY_TICKS, 2 * WAYPOINT_EVERY_TICKS]
    picture = np.frombuffer(bytes(pictures[1][0]), np.uint8).reshape(2, 3, 4)
    # Rows run from the far side; the most probable cell (1, 1) is white.
    assert tuple(picture[0, 1]) == tuple(belief_colors()[-1])
    assert tuple(picture[1, 1]) != tuple(belief_colors()[-1])


def test_how_good_a_belief_is_is_written_when_it_is_news(record):
    path = record(n_ticks=N_TICKS, believers=("agent_0",))
    ticks, _, values = column(path, "/plots/belief_frac/agent_0", "Scalars:scalars")
    assert ticks == [0, WAYPOINT_EVERY_TICKS, 2 * WAYPOINT_EVERY_TICKS]
    np.testing.assert_allclose([value[0] for value in values], [0.25, 0.26, 0.27])
    _, _, distances_m = column(path, "/plots/distance_m/agent_0/belief", "Scalars:scalars")
    np.testing.assert_allclose([value[0] for value in distances_m], [2.5, 2.6, 2.7])


def test_without_beliefs_there_is_nothing_of_them(record, rows_of):
    assert not [entity for entity in rows_of(record()) if "belief" in entity]


def test_only_who_believes_has_a_map_of_beliefs(make_room):
    names = view_names(default_blueprint(scenario(n_agents=3), make_room(), believers=("agent_0", "agent_2")))
    maps = [name for name in names if name.startswith("Belief of ")]
    assert maps == [f"Belief of {name}" for name in ("agent_0", "agent_2")]
    assert "Belief within 1 m of the source [1]" in names
    assert not [name for name in view_names(default_blueprint(scenario(), make_room())) if "elie" in name]


def test_a_belief_in_space_is_summed_over_the_height():
    from gslcosim.contract.record import NumericArray

    p = np.zeros((2, 2, 3), np.float32)
    p[0, 1] = (0.25, 0.25, 0.5)
    in_space = belief_of(0).model_copy(update={"probability": NumericArray.from_array(p)})
    np.testing.assert_allclose(sum_over_height(in_space), [[0.0, 1.0], [0.0, 0.0]])
