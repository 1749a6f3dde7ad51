"""The campaign's table speaks of every fault, and its trials try each of them."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from fault_campaign import LONGEST_STOP_S, fault_of
from fault_expectations import AGENT_FAILED, GOES_ON, MEMBERS, NAMED, PHASES, SIGNALS, TAKEN_ALONG, expected

EVERY_FAULT = [(member, signal, phase) for member in MEMBERS for signal in SIGNALS for phase in PHASES]


def test_every_fault_has_an_expectation():
    assert {outcome for fault in EVERY_FAULT for outcome in expected(*fault)} == {
        GOES_ON, NAMED, AGENT_FAILED, TAKEN_ALONG,
    }  # fmt: skip
    assert expected("recorder", "stopped for ever", "flight") == (NAMED,)
    assert expected("supervisor", "stopped 8-60 s", "flight") == (GOES_ON,)
    assert expected("agent on the bus", "killed", "start") == (AGENT_FAILED,)
    assert all(expected(member, "stopped 1-3 s", phase) == (GOES_ON,) for member in MEMBERS for phase in PHASES)


def test_each_round_of_trials_tries_every_fault_once():
    for n_before in (0, len(EVERY_FAULT)):
        trials = [fault_of(1, n_before + n, LONGEST_STOP_S) for n in range(len(EVERY_FAULT))]
        assert sorted((fault.member, fault.signal, fault.phase) for fault in trials) == sorted(EVERY_FAULT)
        assert all(1 <= fault.stop_s <= LONGEST_STOP_S for fault in trials)
    assert fault_of(1, 5, LONGEST_STOP_S) == fault_of(1, 5, LONGEST_STOP_S)
    assert fault_of(1, 5, LONGEST_STOP_S) != fault_of(2, 5, LONGEST_STOP_S)
