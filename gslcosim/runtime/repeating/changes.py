"""What a fork may change of a scenario: nothing that the run before the fork depends on."""

import re
from collections.abc import Iterator
from typing import Any, cast

from gslcosim.errors import UsageError
from gslcosim.runtime.repeating.event_changes import problems_of_changed_events
from gslcosim.scenario import Scenario
from gslcosim.scenario.dumping import plain_values
from gslcosim.ticks import seconds_from_ticks

# Processes of agents, what they are told and set to, and what is written: none of it is in a message of the past.
_OF_AGENTS = "start|parameters|knows|seed|answer_within_s|sandbox|limits|may_read|may_write|environment"
_FREE = re.compile(rf"agents\[\d+\]\.({_OF_AGENTS})\b.*|(recording|snapshots|restart|processes)\b.*|pace|name")
_TIME_LIMIT = "referee.stop.time_limit_s"
_MAY_BE_SET = (
    "start, parameters, knows, seed, answer_within_s, sandbox, limits, may_read, may_write and environment of agents, "
    f"recording, snapshots, restart, processes, pace, events at times after it, and {_TIME_LIMIT}"
)
# By the beginning of a path: why it is part of the past.
_REASONS = (
    ("seed", "all that was drawn at random follows from it; agents[0].seed gives one agent another"),
    ("environment", "the run was flown in that room"),
    ("wind", "the gas was carried by that wind"),
    ("gas", "the gas that was sensed came from there"),
    ("agents", "what was flown and sensed follows from it"),
    ("referee", "what was judged follows from it"),
    ("channels", "what was heard follows from it"),
    ("services", "they took part"),
    ("tick_ms", "it is the clock of the run"),
)


def check_changes(before: Scenario, after: Scenario, *, at_tick: int) -> None:
    """Hold a fork's scenario against that of the run it forks.

    Args:
        before: The run's scenario.
        after: The fork's.
        at_tick: Where the fork begins.

    Raises:
        UsageError: something that the past depends on is another; all such paths in one error.
    """
    at_s = seconds_from_ticks(at_tick, before.tick_ns)
    problems: list[str] = []
    for path in changed_paths(plain_values(before), plain_values(after)):
        if path.startswith("events"):
            continue
        if path == _TIME_LIMIT:
            if after.referee.stop.time_limit_s <= at_s:
                limit_s = after.referee.stop.time_limit_s
                problems.append(f"{path}: expected a time after the fork at {at_s:g} s, was {limit_s:g} s.")
        elif not _FREE.fullmatch(path):
            problems.append(f"{path}: expected as in the run, was changed: {_reason(path)}.")
    problems += problems_of_changed_events(before, after, at_tick=at_tick)
    if problems:
        raise UsageError("\n".join([*problems, f"A fork may change {_MAY_BE_SET}."]))


def changed_paths(before: Any, after: Any, at: str = "") -> Iterator[str]:
    """Yield the paths at which plain values differ, such as `agents[0].start.python`; a lack is a difference."""
    if isinstance(before, dict) and isinstance(after, dict):
        old, new = cast("dict[str, Any]", before), cast("dict[str, Any]", after)
        for key in dict.fromkeys([*old, *new]):
            path = f"{at}.{key}" if at else key
            if key in old and key in new:
                yield from changed_paths(old[key], new[key], path)
            else:
                yield path
    elif (lists := _lists_of_blocks(before, after)) is not None:
        for i, (old_item, new_item) in enumerate(zip(*lists, strict=True)):
            yield from changed_paths(old_item, new_item, f"{at}[{i}]")
    elif before != after:
        yield at


# Others are changed as a whole: an item more would shift those behind it.
def _lists_of_blocks(before: Any, after: Any) -> tuple[list[Any], list[Any]] | None:
    if not (isinstance(before, list) and isinstance(after, list)):
        return None
    old, new = cast("list[Any]", before), cast("list[Any]", after)
    are_blocks = len(old) == len(new) and all(isinstance(item, dict) for item in (*old, *new))
    return (old, new) if are_blocks else None


def _reason(path: str) -> str:
    first = re.split(r"[.\[]", path, maxsplit=1)[0]
    return dict(_REASONS).get(first, "the run before the fork depends on it")
