"""Scores of events beside releases: overlaps of a minute."""

from gslcosim_search.fixed_sensors.events import LeakEvent
from gslcosim_validation.cases.network_events import find_overlaps
from gslcosim_validation.readers.mast_network import LoggedRelease


def release(start_s, end_s):
    return LoggedRelease(1, start_s, end_s, "well", None, 1e-4)


def test_an_event_must_overlap_a_release_by_a_minute():
    events = (LeakEvent(0, 9, 0.0, 600.0), LeakEvent(20, 29, 1200.0, 1800.0))
    assert find_overlaps(events, release(300.0, 900.0)) == [0]
    assert find_overlaps(events, release(500.0, 1500.0)) == [0, 1]
    assert find_overlaps(events, release(700.0, 1100.0)) == []
    # The last reading lasts for its minute.
    assert find_overlaps(events, release(600.0, 900.0)) == [0]
    assert find_overlaps(events, release(630.0, 900.0)) == []
