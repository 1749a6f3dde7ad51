"""Agents with one fault each: the rule meant for it finds it, and only rules that follow from it fail beside it."""

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from gslcosim_conformance import ConnectionSpec, SessionLimits, check_agent

MUTANT = Path(__file__).parent / "agents" / "mutant.py"
# How busy the machine is decides nothing: only of what breaks a limit anybody waits for its end.
PATIENT = SessionLimits(join_s=60.0, answer_s=20.0, exit_s=20.0, settle_s=0.3)
# Right starts, answers and exits stay within these on a slow and busy machine too.
IMPATIENT = SessionLimits(join_s=20.0, answer_s=10.0, exit_s=10.0, settle_s=0.3)
BREAKS_A_LIMIT = {
    "late", "silent", "unflushed", "answers_for_another", "silent_at_repeats", "decides_anew",
    "tick_minus_one", "forgets_the_namespace", "never_exits", "thread_left_over", "ignores_stream_end",
    "waits_for_a_question",
}  # fmt: skip

# Name, what fails (first the rule meant for it, then what follows from it), and words that lead to the fix.
OVER_PIPES = {
    "crash_at_start": (["joins"], "no licence found"),
    "late": (["deadline"], "one after "),
    "silent": (["answers"], "nothing within"),
    "crash_in_flight": (["stays"], "plume"),
    "leaves_early": (["stays"], "exit code 0 before the end of the run"),
    "closes_output": (["stays"], "its output ended before the end of the run"),
    "never_exits": (["ending", "stream-end"], "it still runs 10 s later"),
    "thread_left_over": (["ending"], "it still runs 10 s later"),
    "ignores_stream_end": (["stream-end"], "it still runs 10 s later"),
    "exits_with_3": (["exit-code"], "ended with exit code 3"),
    "waits_for_a_question": (["early-ending"], "s later, and was ended by force"),
    "lock_file": (["restart"], "running.lock"),
    "leaves_a_daemon": (["leaves-nothing"], "sleep 1000 (process "),
    "key_twice": (["encoding"], "expected each key once, was 'tick' 2 times"),
    "without_length": (["encoding"], "is the length before it missing?"),
    "tick_plus_one": (["tick"], '"tick":5'),
    "tick_minus_one": (["tick"], '"tick":3'),
    "tick_counted": (["tick"], '"tick":0'),
    "tick_32_bit": (["tick"], '"tick":0'),
    "tick_float": (["integers"], "tick 4.0, a real number"),
    "tick_text": (["integers"], "tick '4', a text"),
    "not_a_number": (["finite"], "position_world_m.0: nan"),
    "infinite": (["finite"], "hold_s: inf"),
    "reason_is_a_number": (["schema"], "reason: input should be a valid string, was 5"),
    "number_as_key": (["encoding"], "int is not allowed for map key"),
    "numbers_little_endian": (["byte-order"], "with its bytes turned around it is 2.0"),
    "position_as_big_endian_array": (["schema"], "A position is a list of three numbers"),
    "not_msgpack": (["encoding"], "c120676172"),
    "a_list": (["encoding"], "msgpack of a list"),
    "prints": (["encoding"], "It is the text 'deci'"),
    "wrong_map": (["schema"], "kind: field required"),
    "unknown_kind": (["schema"], "was 'goto'"),
    "claims_to_have_failed": (["schema"], "which only the runtime writes"),
    "waypoint_to_nowhere": (["schema"], "a waypoint command needs position_world_m"),
    "huge": (["size"], "was 8000"),
    "other_contract": (["contract"], "was 9.0"),
    "twice": (["once"], "2: Command"),
    "unasked": (["unasked"], '"tick":0'),
    "floods": (["flood"], "messages, and then the check gave up"),
    "believes_too_often": (["beliefs"], "beliefs at ticks 4 and 9"),
    "unseeded": (["determinism"], '"tick":4'),
    "reads_the_clock": (["determinism"], '"tick":4'),
    "remembers_the_last_run": (["determinism"], '"tick":4'),
    "stops_at_an_unknown_field": (["unknown-fields"], "unexpected x_flag"),
    "wants_its_own_minor_version": (["unknown-fields"], "built for an older contract"),
    "needs_optional_fields": (["optional-fields"], "KeyError: 'notice'"),
    "takes_absence_for_news": (["optional-fields"], '"tick":4'),
}
IN_JSON = {
    "unflushed": (["answers"], "nothing within"),
    "not_a_number": (["finite"], "position_world_m.0: nan"),
    "tick_float": (["integers"], "tick 4.0, a real number"),
    "prints": (["encoding"], "deciding for tick 4"),
    "two_objects_on_a_line": (["encoding"], "Extra data"),
    "key_twice": (["encoding"], "expected each key once, was 'tick' 2 times"),
    "in_latin_1": (["encoding"], "expected a line in UTF-8"),
}
OVER_ZENOH = {
    "leaves_a_daemon": (["leaves-nothing"], "sleep 1000 (process "),
    "key_twice": (["encoding"], "expected each key once, was 'tick' 2 times"),
    "not_msgpack": (["encoding"], "c120676172"),
    "huge": (["size"], "8000"),
    "floods": (["flood"], "messages, and then the check gave up"),
    "twice": (["once"], "2: Command"),
    "answers_for_another": (["own-key", "answers"], "agents/agent_2/command"),
    "forges_truth": (["own-key"], "truth/bodies"),
    "spies": (["own-ears"], "a subscription that includes truth/bodies"),
    "asks_for_the_truth": (["own-ears"], "a query of truth/bodies"),
    "forgets_the_namespace": (["joins"], "outside of the namespace"),
    "token_first": (["listens-first"], "a token without them"),
    "decides_anew": (["repeats"], "not the same"),
    "silent_at_repeats": (["repeats"], "nothing"),
    "begins_anew_with_each_briefing": (["repeats"], 'Command {"tick":'),  # the later briefing may come late
    "hangs_up": (["stays"], "its liveliness token vanished before the end of the run"),
    "ignores_stream_end": (["stream-end"], "it still runs 10 s later"),
    "crash_at_start": (["joins"], "no licence found"),
}


CASES = {
    **{(name, "stdio", "msgpack"): OVER_PIPES[name] for name in OVER_PIPES},
    **{(name, "stdio", "json"): IN_JSON[name] for name in IN_JSON},
    **{(name, "zenoh", "msgpack"): OVER_ZENOH[name] for name in OVER_ZENOH},
}
RIGHT = [
    ("right", "stdio", "msgpack"),
    ("right", "stdio", "json"),
    ("right", "zenoh", "msgpack"),
    ("waits_for_its_helper", "stdio", "msgpack"),
]
# A check mostly waits: for processes, deadlines and exits.
N_AT_ONCE = 5

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end]


def check(name, transport, frame_format, folder):
    command = (sys.executable, str(MUTANT), name, transport, frame_format)
    limits = IMPATIENT if name in BREAKS_A_LIMIT else PATIENT
    return check_agent(
        ConnectionSpec(command=command, transport=transport, format=frame_format, directory=folder), limits
    )


@pytest.fixture(scope="module")
def reports(request, tmp_path_factory):
    """The reports of all cases that are to be tested, made several at a time."""
    chosen = [item.callspec.params["case"] for item in request.session.items if item.path == Path(__file__)]
    with ThreadPoolExecutor(N_AT_ONCE) as pool:
        yield {case: pool.submit(check, *case, tmp_path_factory.mktemp(case[0])) for case in chosen}


def named(cases):
    return [pytest.param(case, id="-".join(case)) for case in cases]


@pytest.mark.parametrize("case", named(CASES))
def test_a_wrong_agent_is_caught_by_the_rule_meant_for_it(case, reports):
    report = reports[case].result()
    rules, words = CASES[case]
    assert set(report.failed_rules) == set(rules), report.as_text()
    failure = report.finding(rules[0]).failure
    assert words in f"{failure.sent} {failure.got}", report.as_text()
    assert not report.has_passed


@pytest.mark.parametrize("case", named(RIGHT))
def test_the_agent_without_a_fault_breaks_no_rule(case, reports):
    report = reports[case].result()
    assert report.has_passed, report.as_text()
