"""Due events: which of a scenario's events concern a participant, and when."""

from collections.abc import Iterator

from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.participant import Inbox, Read
from gslcosim.scenario.models.events import EventSpec
from gslcosim.scenario.models.scenario import Scenario


def list_event_reads(scenario: Scenario, *kinds: type[EventSpec]) -> tuple[Read, ...]:
    """Return what a participant has to read that obeys some kinds of events: nothing where the scenario has none."""
    has_any = any(isinstance(event, kinds) for event in scenario.events)
    return (Read(port=EVENTS, delay_ticks=1),) if has_any else ()


def find_due_events(scenario: Scenario, inbox: Inbox) -> Iterator[tuple[int, EventSpec]]:
    """Yield the events that take effect in a tick, with their places in the list, in the scenario's order.

    Args:
        scenario: Its `events`.
        inbox: That of the tick, of a participant with `list_event_reads`.
    """
    note = inbox.get(EVENTS)
    if isinstance(note, EventsBeginning):
        for i in note.beginning:
            yield i, scenario.events[i]
