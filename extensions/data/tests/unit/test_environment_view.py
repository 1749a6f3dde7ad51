"""An environment as a recording: everything of it is there, and equal environments give equal files."""

from gslcosim_data.environment_view import record_environment

CRATE = ("crate", (5.0, 4.0, 0.0), (6.0, 6.0, 3.0))


def test_geometry_occupancy_arrows_and_streamlines_are_drawn(make_room, rows_of, tmp_path):
    path = tmp_path / "view.rrd"
    record_environment(make_room(wind_m_s=[(1.0, 0.2, 0.0)], obstacles=[CRATE]), path)
    drawn = {entity for entity, rows in rows_of(path).items() if rows == -1}
    assert {"/room/outline", "/room/obstacles", "/occupancy", "/wind", "/streamlines"} <= drawn


def test_an_empty_still_room_is_shown_too(make_room, rows_of, tmp_path):
    path = tmp_path / "view.rrd"
    record_environment(make_room(), path)
    drawn = rows_of(path)
    assert "/room/outline" in drawn
    assert "/occupancy" not in drawn
    assert "/streamlines" not in drawn
