"""Registration of the events service."""

from gslcosim.contract.participant import Core
from gslcosim.events.ports import events_spec
from gslcosim.runtime.participants import ServiceKind
from gslcosim.runtime.setup import Setup


def _build(setup: Setup) -> Core:
    from gslcosim.events.core import EventsCore

    return EventsCore(setup.scenario)


SERVICE = ServiceKind(
    name="events",
    spec_of=events_spec,
    build=_build,
    is_needed=lambda scenario: bool(scenario.events),
    position=30,
)
