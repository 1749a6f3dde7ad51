"""A stall is explained by the chain of who waits for whom, and its end is named."""

import pytest

from gslcosim.runtime.participant_status import MissingMessage, ParticipantStatus, explain_stall


def participant(name, tick, *missing, state="waiting", **others):
    messages = tuple(
        MissingMessage(port=port, tick=tick + 1, writer=writer, last_tick=tick) for port, writer in missing
    )
    return ParticipantStatus(name=name, state=state, tick=tick, missing=messages, **others)


def test_who_is_in_its_step_is_named_and_those_who_wait_follow():
    stall = explain_stall([
        participant("world", 21, ("agents/beetle/command", "agent_beetle")),
        participant("fields", 19, state="working", occupied_s=7.26),
        participant("sensing", 19, ("truth/filaments", "fields")),
        participant("beetle", 19),
    ])  # fmt: skip
    assert stall.culprit == "fields"
    assert stall.lines == (
        "fields is in its step of tick 20 for 7.3 s.",
        "sensing waits at tick 20 for truth/filaments of tick 20 from fields (got tick 19 last).",
    )


def test_the_chain_leads_over_what_each_one_lacks():
    stall = explain_stall([
        participant("referee", 8, ("truth/samples", "sensing")),
        participant("sensing", 9, ("truth/filaments", "fields")),
        participant("fields", 10, ("agents/beetle/command", "agent_beetle")),
        participant("beetle", 10, state="deciding", occupied_s=12.0),
    ])  # fmt: skip
    assert stall.culprit == "beetle"
    assert stall.lines == (
        "beetle owes a command for tick 10 for 12.0 s.",
        "fields waits at tick 11 for agents/beetle/command of tick 11 from agent_beetle (got tick 10 last).",
        "sensing waits at tick 10 for truth/filaments of tick 10 from fields (got tick 9 last).",
        "referee waits at tick 9 for truth/samples of tick 9 from sensing (got tick 8 last).",
    )


def test_credit_leads_to_the_reader_that_lags_behind():
    stall = explain_stall([
        ParticipantStatus(name="fields", state="waiting", tick=70, lacking_credit=("sensing",)),
        ParticipantStatus(name="sensing", state="silent", tick=71),
    ])  # fmt: skip
    assert stall.culprit == "sensing"
    assert "sensing does not answer: its process is stopped" in stall.text
    assert "fields waits at tick 71 for sensing to catch up" in stall.text


def test_those_that_wait_for_each_other_lack_a_message():
    stall = explain_stall([participant("a", 4, ("b/out", "b")), participant("b", 3, ("a/out", "a"))])
    assert stall.culprit == "b"
    assert stall.lines[0] == "b and what it waits for wait for each other: a message is missing, not late."


def test_what_never_came_is_said_so():
    lacking = MissingMessage(port="truth/bodies", tick=0, writer="world", last_tick=-1)
    stall = explain_stall([ParticipantStatus(name="fields", state="waiting", tick=-1, missing=(lacking,))])
    assert stall.text == "fields waits at tick 0 for truth/bodies of tick 0 from world (got nothing yet)."


@pytest.mark.parametrize("participants", [[], [participant("world", 5, state="done")]])
def test_where_nobody_is_left_there_is_nothing_to_explain(participants):
    assert explain_stall(participants) is None


def test_an_agent_that_owes_nothing_is_not_named_for_a_report_that_got_lost():
    assert explain_stall([participant("recorder", 3, state="done"), participant("beetle", 3)]) is None


def test_who_is_silent_is_named_with_those_who_wait_though_its_tick_is_long_past():
    """Services report every 64 ticks: what is known of a silent one is old."""
    stall = explain_stall([
        ParticipantStatus(name="fields", state="silent", tick=0),
        participant("sensing", 19, ("truth/samples", "fields")),
    ])  # fmt: skip
    assert stall.culprit == "fields"
    assert stall.lines == (
        "fields does not answer: its process is stopped, or hangs. It last reported tick 0.",
        "sensing waits at tick 20 for truth/samples of tick 20 from fields (got tick 19 last).",
    )
