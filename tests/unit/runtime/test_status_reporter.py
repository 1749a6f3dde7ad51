"""A state is reported at once, what changes within it a few times a second, and lateness is reported."""

import pytest

from gslcosim.runtime import status as run_status
from gslcosim.runtime.status import LATE_AFTER_S, StatusReporter


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(run_status.time, "monotonic", lambda: now[0])
    return now


def test_a_new_state_is_reported_at_once_and_the_same_not_too_often(clock):
    reports = []
    teller = StatusReporter(reports.append, 100_000_000, list)
    for state, tick in (("flying", 1), ("flying", 2), ("closing", 3)):
        teller.report_run(state, tick, wall_s=0.05)
    clock[0] += 1.0
    teller.report_run("closing", 4, wall_s=0.1)
    assert [(status.state, status.sim_time_s) for status in reports] == [
        ("flying", 0.1), ("closing", 0.3), ("closing", 0.4),
    ]  # fmt: skip
    assert reports[0].real_time_factor == pytest.approx(2.0)


def test_who_has_not_joined_in_time_is_late(clock):
    reports = []
    teller = StatusReporter(reports.append, 100_000_000, list)
    teller.report_awaited(["world", "beetle"], LATE_AFTER_S)
    clock[0] += 1.0
    teller.report_awaited(["world"], LATE_AFTER_S + 1.0)
    assert [(status.text, status.is_late) for status in reports] == [
        ("waiting for world, beetle", False), ("waiting for world, not here after 5 s", True),
    ]  # fmt: skip
