"""Did you mean …"""

import pytest

from gslcosim.scenario.problems import did_you_mean, nearest, nearest_key

KEYS = ["model", "start_m", "search_height_m", "hold_s", "max_speed_m_s"]


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("hold", "hold_s"), ("hold_ms", "hold_s"), ("hold_time_s", "hold_s"), ("start", "start_m"),
        ("Start_m", "start_m"),
        ("serach_height_m", "search_height_m"), ("search-height-m", "search_height_m"), ("max_speed", "max_speed_m_s"),
    ],
)  # fmt: skip
def test_the_key_is_found_that_was_meant(written, meant):
    assert nearest_key(written, KEYS) == meant


def test_nothing_is_suggested_for_a_word_that_is_like_none():
    assert nearest("wings", KEYS) is None
    assert did_you_mean("wings", KEYS) == ""


def test_case_and_dashes_do_not_matter():
    assert did_you_mean("TGS-2600", ["tgs2600", "anemometer"]) == "Did you mean tgs2600?"
    assert nearest("On-Request", ["on_request", "lockstep"]) == "on_request"
