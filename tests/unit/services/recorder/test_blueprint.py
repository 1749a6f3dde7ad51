"""The layout shows what a run has, and nothing empty."""

import pytest
import rerun.blueprint as rrb
from recording_content import column
from scripted_flight import NOSE_AND_VANE, ON_BOARD, scenario

from gslcosim_services.recorder.blueprint import default_blueprint
from gslcosim_services.recorder.rerun_cli import is_complete

ALWAYS = ["Distance [m]", "Control error [m]", "Decision time [ms]"]
BUMPER = ({"model": "bump", "name": "bumper"},)
CAMERAS = tuple({"model": "camera", "name": f"eye_{i}"} for i in range(5))


def _views(part):
    if isinstance(part, rrb.View):
        return [part]
    return [view for item in part.contents for view in _views(item)]


def _layout(make_room, **arguments):
    """Return the pages of the layout by name."""
    root = default_blueprint(scenario(**arguments), make_room()).root_container
    pages = root.contents if isinstance(root, rrb.Tabs) else [root]
    return {page.name: page for page in pages}


def _plots(page):
    return [view.name for view in _views(page) if isinstance(view, rrb.TimeSeriesView)]


def _pictures(page):
    return [(view.name, view.origin) for view in _views(page) if isinstance(view, rrb.Spatial2DView)]


def test_a_search_has_one_page_with_gas_wind_distance_and_error(make_room):
    pages = _layout(make_room)
    assert list(pages) == ["Flight"]
    assert _plots(pages["Flight"]) == [
        "True ethanol at the sensor [ppm]",
        "Reading of TGS2600 [Ω]",
        "Wind speed [m/s], true in grey",
        *ALWAYS,
    ]


def test_without_sensors_of_gas_and_wind_there_are_no_plots_of_them(make_room):
    assert _plots(_layout(make_room, sensors=BUMPER)["Flight"]) == ALWAYS


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
    views = {view.name: view for view in _views(flight)}
    assert views["Reading of PID [ppm]"].contents == ["+ /plots/response/agent_0/pid"]


def test_several_gases_are_named_as_such(make_room):
    sources = ({"position_m": (5.0, 1.0, 2.0)}, {"position_m": (5.0, 2.0, 2.0), "gas": "methane"})
    assert _plots(_layout(make_room, sources=sources)["Flight"])[0] == "True gas at the sensor [ppm]"


def test_a_vehicle_with_on_board_sensors_has_a_page_with_its_pictures_and_curves(make_room):
    pages = _layout(make_room, sensors=(*NOSE_AND_VANE, *ON_BOARD))
    assert list(pages) == ["Flight", "Sensors of agent_0"]
    page = pages["Sensors of agent_0"]
    cameras = [("camera", "/seen/agent_0/camera"), ("depth_camera (0 to 30 m)", "/seen/agent_0/depth_camera")]
    assert _pictures(page) == cameras
    assert _pictures(pages["Flight"]) == cameras
    assert _plots(page) == [
        "imu: specific force [m/s²]",
        "imu: angular velocity [rad/s]",
        "gps: position [m]",
        "gps: velocity [m/s]",
        "barometer: pressure [Pa]",
        "magnetometer: magnetic field [µT]",
        "pose: position [m]",
        "pose: attitude quaternion",
        "pose: velocity [m/s]",
        "range_finder: range [m]",
        "four_range_finders: ranges [m]",
        "lidar_2d: least range [m]",
        "lidar_3d: least range [m]",
        "bump: contact",
    ]
    assert not [name for name in _plots(pages["Flight"]) if "imu" in name or "BAROMETER" in name]


def test_ten_vehicles_have_ten_pages_and_share_the_plots_of_the_run(make_room):
    pages = _layout(make_room, n_agents=10, sensors=(*NOSE_AND_VANE, {"model": "imu", "name": "imu"}))
    assert list(pages) == ["Flight", *(f"Sensors of agent_{i}" for i in range(10))]
    assert len(_plots(pages["Flight"])) == 6
    origins = {view.origin for view in _views(pages["Sensors of agent_7"])}
    assert origins == {
        "plots/on_board/agent_7/imu/specific_force",
        "plots/on_board/agent_7/imu/angular_velocity",
    }


def test_a_legend_of_many_curves_does_not_cover_them_and_one_curve_has_none(make_room):
    for n_agents, is_shown in ((1, False), (3, True), (10, False)):
        (plot,) = (view for view in _views(_layout(make_room, n_agents=n_agents)["Flight"]) if view.name == ALWAYS[0])
        assert plot.properties["PlotLegend"].visible.as_arrow_array().to_pylist() == [is_shown]


@pytest.mark.parametrize(("n_cameras", "place"), [(1, rrb.Horizontal), (3, rrb.Horizontal), (5, rrb.Tabs)])
def test_a_few_cameras_are_side_by_side_and_many_share_one_place(make_room, n_cameras, place):
    flight = _layout(make_room, sensors=CAMERAS[:n_cameras])["Flight"]
    cameras = flight.contents[1].contents[0]
    assert type(cameras) is place
    assert len(cameras.contents) == n_cameras


def test_cameras_of_several_vehicles_are_distinguished(make_room):
    names = [name for name, _ in _pictures(_layout(make_room, n_agents=2, sensors=CAMERAS[:1])["Flight"])]
    assert names == ["agent_0: eye_0", "agent_1: eye_0"]


def test_radio_has_its_log_where_there_are_channels(make_room):
    logs = {view.name for view in _views(_layout(make_room, channels=({"name": "radio"},))["Flight"])}
    assert {"Referee", "Contacts", "Radio"} <= logs
    assert "Radio" not in {view.name for view in _views(_layout(make_room)["Flight"])}


@pytest.mark.parametrize(
    "flight",
    [{"sensors": BUMPER}, {"n_agents": 10, "sensors": ON_BOARD}, {"sensors": CAMERAS}],
    ids=["a bumper alone", "ten agents with every sensor", "five cameras"],
)
def test_every_such_run_is_recorded_whole(record, flight):
    path = record(n_ticks=3, **flight)
    assert is_complete(path)
    assert column(path, "/vehicles/agent_0", "Transform3D:translation")[0] == [0, 1, 2]
