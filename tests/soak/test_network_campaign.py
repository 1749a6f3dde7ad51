"""The campaign's cases: each link with each window, and one run that waits for its agent."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from network_campaign import LINKS, Flown, cases_of, row_of


def test_each_link_is_run_with_each_window_and_once_closed():
    cases = cases_of((256, 1024), 100, "")
    assert len(cases) == 3 * len(LINKS)
    assert len({(case.link.name, case.is_open, case.window_ticks) for case in cases}) == len(cases)
    assert sum(not case.is_open for case in cases) == len(LINKS)


def test_a_word_chooses_links():
    assert {case.link.name for case in cases_of((256,), 100, "cut")} == {
        link.name for link in LINKS if link.cut_s and "BBR" not in link.name
    }
    assert cases_of((256,), 100, "no such link") == []


def test_another_digest_stands_out_in_its_row():
    case = cases_of((256,), 100, "cable")[0]
    assert "| same |" in row_of(Flown(case=case))
    assert "**other**: digest None" in row_of(Flown(case=case, problem="digest None"))
