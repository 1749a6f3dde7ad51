"""What a room may come to in a run: which of its doors are closed, and whose wind blows in it."""

from collections.abc import Iterable

from gslcosim.environment.model import OWN_WIND, Situation
from gslcosim.scenario.models.event_base import EventSpec
from gslcosim.scenario.models.event_kinds import DoorClosesSpec, DoorOpensSpec, WindChangesSpec
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.ticks import ticks_from_seconds


def after(situation: Situation, i_event: int, event: EventSpec) -> Situation:
    """Return what an event of a scenario makes of a situation; the same where it is about something else."""
    closed, i_wind = situation
    match event:
        case DoorOpensSpec():
            return Situation(tuple(name for name in closed if name != event.door), i_wind)
        case DoorClosesSpec():
            return Situation(tuple(sorted({*closed, event.door})), i_wind)
        case WindChangesSpec():
            return Situation(closed, OWN_WIND if event.inlet_velocity_m_s is None else i_event)
        case _:
            return situation


def first_situation(scenario: Scenario) -> Situation:
    """Return the situation at the start of a run."""
    return Situation(closed=tuple(sorted(door.name for door in scenario.environment.doors if not door.is_open)))


def situations_of(scenario: Scenario) -> list[Situation]:
    """Return all situations that a run may come to, the first one first.

    Where all events that matter have a time they follow each other; with conditions any order is possible.
    """
    first = first_situation(scenario)
    mattering = [(i, event) for i, event in enumerate(scenario.events) if event.drives_wind]
    if all(event.at_s is not None for _, event in mattering):
        mattering.sort(key=lambda item: ticks_from_seconds(item[1].at_s or 0.0, scenario.tick_ns))
        return list(dict.fromkeys(_one_after_another(first, mattering)))
    found = {first: None}
    waiting = [first]
    while waiting:
        situation = waiting.pop()
        for i, event in mattering:
            later = after(situation, i, event)
            if later not in found:
                found[later] = None
                waiting.append(later)
    return list(found)


def scenarios_of_rooms(scenario: Scenario) -> list[Scenario]:
    """Return the scenario as it is, and for each other room that its doors make one that starts in it."""
    first, *later = situations_of(scenario)
    rooms = {each.closed: scenario_in(scenario, each) for each in later if each.closed != first.closed}
    return [scenario, *rooms.values()]


def scenario_in(scenario: Scenario, situation: Situation) -> Scenario:
    """Return the scenario whose room and wind are at the start what they are in a situation."""
    doors = tuple(
        door.model_copy(update={"is_open": door.name not in situation.closed}) for door in scenario.environment.doors
    )
    wind = scenario.wind
    if situation.i_wind != OWN_WIND:
        event = scenario.events[situation.i_wind]
        assert isinstance(event, WindChangesSpec), "only such an event brings a wind"
        wind = wind.model_copy(update={"inlet_velocity_m_s": event.inlet_velocity_m_s})
    environment = scenario.environment.model_copy(update={"doors": doors})
    return scenario.model_copy(update={"environment": environment, "wind": wind})


def _one_after_another(first: Situation, events: Iterable[tuple[int, EventSpec]]) -> Iterable[Situation]:
    yield first
    situation = first
    for i, event in events:
        situation = after(situation, i, event)
        yield situation
