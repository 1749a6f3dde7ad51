"""What events do to the sources of a plume."""

from gslcosim.contract.participant import Inbox
from gslcosim.errors import ModelError
from gslcosim.fields.filament.plume import FilamentPlume
from gslcosim.fields.filament.taps import SourceChange
from gslcosim.fields.gas_field import GasField
from gslcosim.fields.reading.filament_field import FilamentField
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import due_events
from gslcosim.scenario.models.event_kinds import (
    SourceEventSpec,
    SourceMovesSpec,
    SourceRateSpec,
    SourceStartsSpec,
    SourceStopsSpec,
)


class GasEvents:
    """Changes the sources of a run's gas as its events say; it does nothing where there are none."""

    def __init__(self, scenario: Scenario, gas: GasField) -> None:
        """Prepare for the events of a scenario.

        Raises:
            ModelError: the scenario has events of sources, and its gas has none that can change.
        """
        self._scenario = scenario
        events = [event for event in scenario.events if isinstance(event, SourceEventSpec)]
        self._plume = gas.source if isinstance(gas, FilamentField) else None
        if events and not isinstance(self._plume, FilamentPlume):
            raise ModelError("events: expected gas whose sources can change, of model filament without a tape.")
        self._closed_at_first = closed_sources(scenario)

    def reset(self) -> None:
        """Close the sources that an event starts; called after the gas was reset."""
        for i_source in self._closed_at_first:
            self._change(i_source, SourceChange(is_open=False))

    def obey(self, inbox: Inbox) -> None:
        """Do what takes effect in this tick."""
        for _, event in due_events(self._scenario, inbox):
            if isinstance(event, SourceEventSpec):
                self._change(event.source, self._change_of(event))

    def _change(self, i_source: int, change: SourceChange) -> None:
        assert isinstance(self._plume, FilamentPlume)
        self._plume.change_source(i_source, change)

    def _change_of(self, event: SourceEventSpec) -> SourceChange:
        match event:
            case SourceStartsSpec():
                return SourceChange(is_open=True)
            case SourceStopsSpec():
                return SourceChange(is_open=False)
            case SourceMovesSpec():
                return SourceChange(position_world_m=event.to_m)
            case SourceRateSpec():
                source = self._scenario.gas.sources[event.source]
                return SourceChange(share=event.filaments_per_s / source.filaments_per_s)
            case _:
                raise ModelError(f"events: expected an event of a source that is known, was {event.what!r}.")


def closed_sources(scenario: Scenario) -> list[int]:
    """Return the sources that are closed at first: those whose first start or stop in the list is a start."""
    firsts: dict[int, bool] = {}
    for event in scenario.events:
        if isinstance(event, SourceStartsSpec | SourceStopsSpec):
            firsts.setdefault(event.source, isinstance(event, SourceStartsSpec))
    return [i for i, is_start in firsts.items() if is_start]
