"""Leak monitor: reports once, in time, what the whole log would tell."""

import numpy as np
import pytest
from mast_campaigns import FIRST, LAST, PLACES_M, write_campaign

from gslcosim_search.fixed_sensors.leak_monitor import LeakMonitor
from gslcosim_validation.readers.mast_network import read_mast_network


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    """Return a campaign with a leak at the well."""
    return read_mast_network(write_campaign(tmp_path_factory.mktemp("data") / "yard"))


def reports_of(network, *, places_m):
    """Return when each report came [min since the log began] and the report."""
    monitor = LeakMonitor(network.masts_m, source_height_m=2.0, period_s=60.0, places_m=places_m)
    found = []
    for i in range(len(network.clock_s)):
        rows = monitor.add(network.clock_s[i], network.readings_ppm[i], network.wind_world_m_s[i])
        found += [(i, report) for report in rows]
    return found


def test_a_leak_is_reported_once_after_it_is_over(network):
    places_m = {name: np.array(place_m) for name, place_m in network.places_m.items()}
    ((minute, report),) = reports_of(network, places_m=places_m)
    begin_s = network.clock_s[0]
    assert LAST + 60 <= minute < LAST + 60 + 60
    assert report.position_m == PLACES_M["well"]
    assert report.start_s == pytest.approx(begin_s + 60.0 * FIRST, abs=1800.0)
    assert report.end_s == pytest.approx(begin_s + 60.0 * LAST, abs=1800.0)
    (release,) = network.releases
    assert report.rate_m3_s == pytest.approx(1.473 * release.rate_kg_s, rel=0.3)


@pytest.mark.slow
def test_without_candidates_it_is_somewhere_near(network):
    ((_, report),) = reports_of(network, places_m=None)
    assert np.hypot(*np.subtract(report.position_m, PLACES_M["well"])) < 10.0


def test_clean_air_brings_no_report(network):
    quiet = LeakMonitor(network.masts_m, source_height_m=2.0, period_s=60.0)
    for i in range(FIRST):
        assert quiet.add(network.clock_s[i], network.readings_ppm[i], network.wind_world_m_s[i]) == []
