"""The layout shows what a run has, and nothing empty."""

import pytest
import rerun.blueprint as rrb
from recording_content import column, views
from scripted_flight import ON_BOARD, scenario

from gslcosim_services.recorder.blueprint import default_blueprint
from gslcosim_services.recorder.rerun_cli import is_complete

ALWAYS = ["Distance [m]", "Control error [m]", "Decision time [ms]"]
BUMPER = ({"model": "bump", "name": "bumper"},)
CAMERAS = tuple({"model": "camera", "name": f"eye_{i}"} for i in range(5))


def _layout(make_room, **arguments):
    """Return the pages of the layout by name."""
    root = default_blueprint(scenario(**arguments), make_room()).root_container
    pages = root.contents if isinstance(root, rrb.Tabs) else [root]
    return {page.name: page for page in pages}


def _plots(page):
    return [view.name for view in views(page) if isinstance(view, rrb.TimeSeriesView)]


def test_a_search_has_one_page_with_gas_wind_distance_and_error(make_room):
    pages = _layout(make_room)
    assert list(pages) == ["Flight"]
    assert _plots(pages["Flight"]) == [
        "True ethanol at the sensor [ppm]",
        "Reading of TGS2600 [Ω]",
        "Wind speed [m/s], true in grey",
        *ALWAYS,
    ]


def test_readings_of_different_units_do_not_share_a_plot(make_room):
    models = ("tgs2600", "tgs2611", "pid", "hit_counter", "tdlas")
    sensors = tuple({"model": model, "name": model} for model in models)
    flight = _layout(make_room, sensors=sensors)["Flight"]
    assert _plots(flight)[1:-3] == [
        "Reading of TGS2600, TGS2611 [Ω]",
        "Reading of PID [ppm]",
        "Reading of hit counter",
        "Reading of TDLAS [ppm·m]",
    ]
    by_name = {view.name: view for view in views(flight)}
    assert by_name["Reading of PID [ppm]"].contents == ["+ /plots/response/agent_0/pid"]


@pytest.mark.parametrize(("n_cameras", "place"), [(1, rrb.Horizontal), (3, rrb.Horizontal), (5, rrb.Tabs)])
def test_a_few_cameras_are_side_by_side_and_many_share_one_place(make_room, n_cameras, place):
    flight = _layout(make_room, sensors=CAMERAS[:n_cameras])["Flight"]
    cameras = flight.contents[1].contents[0]
    assert type(cameras) is place
    assert len(cameras.contents) == n_cameras


def test_radio_has_its_log_where_there_are_channels(make_room):
    logs = {view.name for view in views(_layout(make_room, channels=({"name": "radio"},))["Flight"])}
    assert {"Referee", "Contacts", "Radio"} <= logs
    assert "Radio" not in {view.name for view in views(_layout(make_room)["Flight"])}


@pytest.mark.parametrize(
    "flight",
    [{"sensors": BUMPER}, {"n_agents": 10, "sensors": ON_BOARD}, {"sensors": CAMERAS}],
    ids=["a bumper alone", "ten agents with every sensor", "five cameras"],
)
def test_every_such_run_is_recorded_whole(record, flight):
    path = record(n_ticks=3, **flight)
    assert is_complete(path)
    assert column(path, "/vehicles/agent_0", "Transform3D:translation")[0] == [0, 1, 2]
