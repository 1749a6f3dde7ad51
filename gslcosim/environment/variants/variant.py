"""Variant of an environment: which of its doors are closed, and whose wind blows in it."""

from collections.abc import Iterable

from gslcosim.base.ticks import ticks_from_seconds
from gslcosim.environment.model import OWN_WIND, EnvironmentVariant
from gslcosim.scenario.models.events import DoorClosesSpec, DoorOpensSpec, EventSpec, WindChangesSpec
from gslcosim.scenario.models.scenario import Scenario


def variant_after(variant: EnvironmentVariant, i_event: int, event: EventSpec) -> EnvironmentVariant:
    """Return what an event of a scenario makes of a situation; the same where it is about something else."""
    closed, i_wind = variant
    match event:
        case DoorOpensSpec():
            return EnvironmentVariant(tuple(name for name in closed if name != event.door), i_wind)
        case DoorClosesSpec():
            return EnvironmentVariant(tuple(sorted({*closed, event.door})), i_wind)
        case WindChangesSpec():
            return EnvironmentVariant(closed, OWN_WIND if event.inlet_velocity_m_s is None else i_event)
        case _:
            return variant


def first_variant(scenario: Scenario) -> EnvironmentVariant:
    """Return the situation at the start of a run."""
    return EnvironmentVariant(
        closed=tuple(sorted(door.name for door in scenario.environment.doors if not door.is_open))
    )


def find_variants(scenario: Scenario) -> list[EnvironmentVariant]:
    """Return all situations that a run may come to, the first one first.

    Where all events that matter have a time they follow each other; with conditions any order is possible.
    """
    first = first_variant(scenario)
    mattering = [(i, event) for i, event in enumerate(scenario.events) if event.drives_wind]
    if all(event.at_s is not None for _, event in mattering):
        mattering.sort(key=lambda item: ticks_from_seconds(item[1].at_s or 0.0, scenario.tick_ns))
        return list(dict.fromkeys(_one_after_another(first, mattering)))
    found = {first: None}
    waiting = [first]
    while waiting:
        variant = waiting.pop()
        for i, event in mattering:
            later = variant_after(variant, i, event)
            if later not in found:
                found[later] = None
                waiting.append(later)
    return list(found)


def variant_scenarios(scenario: Scenario) -> list[Scenario]:
    """Return the scenario as it is, and for each other room that its doors make one that starts in it."""
    first, *later = find_variants(scenario)
    rooms = {each.closed: scenario_in_variant(scenario, each) for each in later if each.closed != first.closed}
    return [scenario, *rooms.values()]


def scenario_in_variant(scenario: Scenario, variant: EnvironmentVariant) -> Scenario:
    """Return the scenario whose room and wind are at the start what they are in a situation."""
    doors = tuple(
        door.model_copy(update={"is_open": door.name not in variant.closed}) for door in scenario.environment.doors
    )
    wind = scenario.wind
    if variant.i_wind != OWN_WIND:
        event = scenario.events[variant.i_wind]
        assert isinstance(event, WindChangesSpec), "only such an event brings a wind"
        wind = wind.model_copy(update={"inlet_velocity_m_s": event.inlet_velocity_m_s})
    environment = scenario.environment.model_copy(update={"doors": doors})
    return scenario.model_copy(update={"environment": environment, "wind": wind})


def _one_after_another(
    first: EnvironmentVariant, events: Iterable[tuple[int, EventSpec]]
) -> Iterable[EnvironmentVariant]:
    yield first
    variant = first
    for i, event in events:
        variant = variant_after(variant, i, event)
        yield variant
