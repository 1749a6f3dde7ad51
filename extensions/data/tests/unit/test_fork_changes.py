"""What a fork may change: nothing that the past depends on."""

import pytest
from pydantic import TypeAdapter

from gslcosim.base.errors import UsageError
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.serialization import plain_values
from gslcosim_data.fork_changes import check_changes, find_changed_paths


def changed(scenario, path, value):
    values = plain_values(scenario)
    *holders, last = [
        int(word) if word.isdigit() else word for word in path.replace("[", ".").replace("]", "").split(".")
    ]
    block = values
    for word in holders:
        block = block[word] if isinstance(block, list) else block.setdefault(word, {})
    block[last] = value
    return TypeAdapter(Scenario).validate_python(values)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("agents[0].seed", 3),
        ("agents[0].start.python", "infotaxis"),
        ("agents[0].parameters", {"step_m": 2}),
        ("agents[0].knows.map", True),
        ("recording.gas_every_s", 0.5),
        ("processes", "grouped"),
        ("referee.stop.time_limit_s", 3.0),
    ],
)
def test_what_no_message_of_the_past_depends_on_may_change(make_scenario, path, value):
    scenario = make_scenario()
    check_changes(scenario, changed(scenario, path, value), at_tick=20)


@pytest.mark.parametrize(
    ("path", "value", "reason"),
    [
        ("seed", 3, "all that was drawn at random"),
        ("gas.warm_up_s", 3.0, "the gas that was sensed"),
        ("wind.cell_m", 0.5, "carried by that wind"),
        ("agents[0].vehicle.hold_s", 3.0, "was flown and sensed"),
        ("agents[0].mode", "lockstep", "was flown and sensed"),
        ("agents[0].name", "other", "was flown and sensed"),
        ("referee.success.within_m", 3.0, "was judged"),
        ("referee.stop.time_limit_s", 2.0, "after the fork at 2 s"),
        ("tick_ms", 200, "the clock of the run"),
        ("environment.layout.seed", 8, "in that room"),
    ],
)
def test_what_the_past_depends_on_is_named_with_its_reason(make_scenario, path, value, reason):
    scenario = make_scenario()
    with pytest.raises(UsageError, match=reason) as refused:
        check_changes(scenario, changed(scenario, path, value), at_tick=20)
    assert str(refused.value).startswith(f"{path}: expected")


def test_all_of_them_are_reported_at_once(make_scenario):
    scenario = make_scenario()
    other = changed(changed(scenario, "seed", 3), "agents[0].vehicle.hold_s", 1.0)
    with pytest.raises(UsageError, match=r"(?s)seed: .*agents\[0\]\.vehicle\.hold_s: .*A fork may change"):
        check_changes(scenario, other, at_tick=20)


def test_paths_lead_into_blocks_of_lists():
    before = {"a": [{"b": 1}, {"b": [1, 2]}], "c": 1}
    after = {"a": [{"b": 1}, {"b": [1, 3]}], "d": 1}
    assert list(find_changed_paths(before, after)) == ["a[1].b", "c", "d"]
    assert list(find_changed_paths({"a": [{}]}, {"a": [{}, {}]})) == ["a"]


EVENTS = {
    "stop": {"what": "source_stops", "at_s": 1.0},
    "rate": {"what": "source_rate", "at_s": 2.0, "filaments_per_s": 3.0},
    "late": {"what": "wind_changes", "at_s": 2.1, "share": 0.5},
    "later": {"what": "wind_changes", "at_s": 2.5},
    "when": {"what": "source_stops", "when": {"agent": "beetle", "gas_above_ppm": 1.0}},
    "value": {"what": "source_stops", "when": {"participant": "hvac", "value": "state.level", "above": 1.0}},
    "start": {"what": "source_starts", "at_s": 2.6},
}


def with_events(scenario, *names):
    return changed(scenario, "events", [EVENTS[name] for name in names])


@pytest.mark.parametrize(
    ("before", "after"),
    [((), ("late",)), (("stop",), ("late", "stop", "later")), (("stop", "late"), ("stop",)),
     (("when",), ("when", "later")), (("stop",), ("stop", "start"))],
)  # fmt: skip
def test_what_happens_after_the_fork_may_be_added_and_left_out(make_scenario, before, after):
    scenario = make_scenario()
    check_changes(with_events(scenario, *before), with_events(scenario, *after), at_tick=20)


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ((), ("rate",), "events[0].at_s: expected a time after the fork at 2 s, was 2 s."),
        ((), ("late", "stop"), "events[1].at_s: expected a time after the fork at 2 s, was 1 s."),
        (("stop",), (), "events: expected source_stops at 1 s, as in the run, was left out or changed"),
        ((), ("when",), "events[0].when: expected at_s for an event that the run has not"),
        (("when",), (), "events: expected source_stops once beetle is in more than 1 ppm, as in the run"),
        (("value",), (), "events: expected source_stops once state.level of hvac is above 1, as in the run"),
        ((), ("start",), "events: expected no source_starts as the first of source 0"),
    ],
)
def test_what_may_be_past_is_refused_by_name(make_scenario, before, after, expected):
    scenario = make_scenario()
    with pytest.raises(UsageError) as refused:
        check_changes(with_events(scenario, *before), with_events(scenario, *after), at_tick=20)
    assert expected in str(refused.value)
