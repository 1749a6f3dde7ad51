"""Changes that a fork may make to its run's scenario: none on which its past depends."""

import re
from collections.abc import Iterator
from typing import Any, cast

from gslcosim.base.errors import UsageError
from gslcosim.base.scenario_keys import list_live_keys
from gslcosim.base.ticks import seconds_from_ticks, ticks_from_seconds
from gslcosim.scenario.models.events import EventSpec, SourceStartsSpec, SourceStopsSpec
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.serialization import plain_values

# Processes of agents, their inputs and settings, and output: none of it is in a message of the past.
_CHANGEABLE_AGENT_KEYS = "start|parameters|knows|seed|answer_within_s|sandbox|limits|may_read|may_write|environment"
_CHANGEABLE_BLOCKS = ("recording", "snapshots", "restart", "processes")
_TIME_LIMIT = "referee.stop.time_limit_s"
# Reason for being part of the past, by the beginning of a path.
_REASONS = {
    "seed": "all that was drawn at random follows from it; agents[0].seed gives one agent another",
    "environment": "the run was flown in that room",
    "wind": "the gas was carried by that wind",
    "gas": "the gas that was sensed came from there",
    "agents": "what was flown and sensed follows from it",
    "referee": "what was judged follows from it",
    "channels": "what was heard follows from it",
    "services": "they took part",
    "tick_ms": "it is the clock of the run",
}


def find_event_problems(before: Scenario, after: Scenario, *, at_tick: int) -> Iterator[str]:
    """Yield the changes of a fork to events on which its past depends."""
    at_s = seconds_from_ticks(at_tick, before.tick_ns)
    past = [event for event in before.events if _could_be_past(event, before, at_tick)]
    for i, event in enumerate(after.events):
        if not _could_be_past(event, after, at_tick):
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
    closed = _list_sources_closed_at_start(after) - _list_sources_closed_at_start(before)
    for source in sorted(closed):
        yield (
            f"events: expected no source_starts as the first of source {source}: it would be closed from the beginning."
        )


def _could_be_past(event: EventSpec, scenario: Scenario, at_tick: int) -> bool:
    return event.at_s is None or ticks_from_seconds(event.at_s, scenario.tick_ns) <= at_tick


def _list_sources_closed_at_start(scenario: Scenario) -> set[int]:
    firsts: dict[int, bool] = {}
    for event in scenario.events:
        if isinstance(event, SourceStartsSpec | SourceStopsSpec):
            firsts.setdefault(event.source, isinstance(event, SourceStartsSpec))
    return {source for source, is_start in firsts.items() if is_start}


def check_changes(before: Scenario, after: Scenario, *, at_tick: int) -> None:
    """Refuse changes of a fork's scenario to the past of its run."""
    at_s = seconds_from_ticks(at_tick, before.tick_ns)
    blocks = [*_CHANGEABLE_BLOCKS, *(key.name for key in list_live_keys())]
    pattern = re.compile(rf"agents\[\d+\]\.({_CHANGEABLE_AGENT_KEYS})\b.*|({'|'.join(blocks)})\b.*|pace|name")
    problems: list[str] = []
    for path in find_changed_paths(plain_values(before), plain_values(after)):
        if path.startswith("events"):
            continue
        if path == _TIME_LIMIT:
            if after.referee.stop.time_limit_s <= at_s:
                limit_s = after.referee.stop.time_limit_s
                problems.append(f"{path}: expected a time after the fork at {at_s:g} s, was {limit_s:g} s.")
        elif not pattern.fullmatch(path):
            first = re.split(r"[.\[]", path, maxsplit=1)[0]
            reason = _REASONS.get(first, "the run before the fork depends on it")
            problems.append(f"{path}: expected as in the run, was changed: {reason}.")
    problems += find_event_problems(before, after, at_tick=at_tick)
    if problems:
        *keys, last = _CHANGEABLE_AGENT_KEYS.split("|")
        changeable = (
            f"{', '.join(keys)} and {last} of agents, {', '.join(blocks)}, pace, events at times after it, and "
            f"{_TIME_LIMIT}"
        )
        raise UsageError("\n".join([*problems, f"A fork may change {changeable}."]))


def find_changed_paths(before: Any, after: Any, at: str = "") -> Iterator[str]:
    """Yield the paths at which plain values differ or are missing, such as `agents[0].start.python`."""
    if isinstance(before, dict) and isinstance(after, dict):
        old, new = cast("dict[str, Any]", before), cast("dict[str, Any]", after)
        for key in dict.fromkeys([*old, *new]):
            path = f"{at}.{key}" if at else key
            if key in old and key in new:
                yield from find_changed_paths(old[key], new[key], path)
            else:
                yield path
    elif (lists := _are_block_lists(before, after)) is not None:
        for i, (old_item, new_item) in enumerate(zip(*lists, strict=True)):
            yield from find_changed_paths(old_item, new_item, f"{at}[{i}]")
    elif before != after:
        yield at


# Other lists are compared as a whole: one item more would shift those behind it.
def _are_block_lists(before: Any, after: Any) -> tuple[list[Any], list[Any]] | None:
    if not (isinstance(before, list) and isinstance(after, list)):
        return None
    old, new = cast("list[Any]", before), cast("list[Any]", after)
    are_blocks = len(old) == len(new) and all(isinstance(item, dict) for item in (*old, *new))
    return (old, new) if are_blocks else None
