"""The watchdog names who is silent for too long, and nobody for time in which it was not looked."""

import pytest

from gslcosim.base.errors import ExitCode
from gslcosim.runtime.distributed.protocol import TickReport
from gslcosim.runtime.distributed.watchdog import LOST_CONTACT_GRACE_S, STALL_TIMEOUT_S, Watchdog
from gslcosim.runtime.participant_status import MissingMessage, ParticipantStatus
from gslcosim.runtime.run_dir import RunDir


@pytest.fixture
def watchdog(tmp_path):
    watchdog = Watchdog([("world",), ("fields",)], RunDir(tmp_path))
    watchdog.moved(100.0)
    return watchdog


def test_a_stall_is_counted_from_the_last_progress(watchdog):
    watchdog.record_progress("world", TickReport(tick=7), 110.0)
    assert watchdog.check(110.0 + STALL_TIMEOUT_S, is_judged=False, look=list) is None
    assert watchdog.check(110.1 + STALL_TIMEOUT_S, is_judged=False, look=list).participant == "fields"


def test_a_stall_is_explained_by_a_look_at_the_participants(watchdog):
    lacking = MissingMessage(port="truth/filaments", tick=8, writer="fields", last_tick=7)
    seen = [
        ParticipantStatus(name="world", state="waiting", tick=7, missing=(lacking,)),
        ParticipantStatus(name="fields", state="silent", tick=8),
    ]
    fault = watchdog.check(100.1 + STALL_TIMEOUT_S, is_judged=False, look=lambda: seen)
    assert (fault.participant, fault.exit_code) == ("fields", ExitCode.TIMEOUT)
    assert "  fields does not answer" in fault.text
    assert "  world waits at tick 8 for truth/filaments of tick 8 from fields (got tick 7 last)." in fault.text


def test_time_in_which_nobody_looked_is_no_stall(watchdog):
    watchdog.record_contact_lost("fields", 600.0)
    watchdog.record_contact_regained("fields")
    watchdog.extend_deadlines(500.0, 601.0)
    assert watchdog.check(600.0 + STALL_TIMEOUT_S, is_judged=False, look=list) is None
    assert watchdog.check(600.1 + STALL_TIMEOUT_S, is_judged=False, look=list) is not None


def test_contact_that_is_lost_with_a_pause_of_this_side_is_lost_in_time_and_says_so(watchdog):
    """Members on other hosts give up a silent router, and are not there any more when it goes on."""
    watchdog.record_contact_lost("fields", 600.0)
    watchdog.extend_deadlines(500.0, 600.1)
    fault = watchdog.check(600.2 + LOST_CONTACT_GRACE_S, is_judged=False, look=list)
    assert fault.participant == "fields"
    assert "The supervisor itself had stood still for 500 s." in fault.text


def test_lost_contact_is_named_unless_it_is_regained(watchdog):
    watchdog.record_contact_lost("fields", 101.0)
    assert watchdog.check(101.0, is_judged=False, look=list) is None
    watchdog.record_contact_regained("fields")
    assert watchdog.check(101.1 + LOST_CONTACT_GRACE_S, is_judged=False, look=list) is None
    watchdog.record_contact_lost("fields", 102.0)
    assert watchdog.check(102.1 + LOST_CONTACT_GRACE_S, is_judged=False, look=list).participant == "fields"
