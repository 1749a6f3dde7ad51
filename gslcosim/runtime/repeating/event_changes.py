"""Which events a fork may have that its run has not: such as happen after the fork, at a time that is known."""

from collections.abc import Iterator

from gslcosim.scenario import Scenario
from gslcosim.scenario.models.event_base import EventSpec
from gslcosim.scenario.models.event_kinds import SourceStartsSpec, SourceStopsSpec
from gslcosim.ticks import seconds_from_ticks, ticks_from_seconds


def problems_of_changed_events(before: Scenario, after: Scenario, *, at_tick: int) -> Iterator[str]:
    """Yield what a fork would change of the events that its past depends on.

    Args:
        before: The run's scenario.
        after: The fork's.
        at_tick: Where the fork begins.
    """
    at_s = seconds_from_ticks(at_tick, before.tick_ns)
    past = [event for event in before.events if _may_be_past(event, before, at_tick)]
    for i, event in enumerate(after.events):
        if not _may_be_past(event, after, at_tick):
            continue
        if event in past:
            past.remove(event)
        elif event.when is not None:
            yield f"events[{i}].when: expected at_s for an event that the run has not: it might have happened before."
        else:
            yield f"events[{i}].at_s: expected a time after the fork at {at_s:g} s, was {event.at_s:g} s."
    for event in past:
        when = event.when.text if event.when is not None else f"at {event.at_s:g} s"
        yield f"events: expected {event.what} {when}, as in the run, was left out or changed: it may be past by then."
    closed = _closed_at_first(after) - _closed_at_first(before)
    for source in sorted(closed):
        yield (
            f"events: expected no source_starts as the first of source {source}: it would be closed from the beginning."
        )


def _may_be_past(event: EventSpec, scenario: Scenario, at_tick: int) -> bool:
    return event.at_s is None or ticks_from_seconds(event.at_s, scenario.tick_ns) <= at_tick


def _closed_at_first(scenario: Scenario) -> set[int]:
    firsts: dict[int, bool] = {}
    for event in scenario.events:
        if isinstance(event, SourceStartsSpec | SourceStopsSpec):
            firsts.setdefault(event.source, isinstance(event, SourceStartsSpec))
    return {source for source, is_start in firsts.items() if is_start}
