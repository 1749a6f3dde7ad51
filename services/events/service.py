"""Registration of the events service."""

from operator import attrgetter

from gslcosim.contract.participant import Core
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim_services.events.ports import events_spec


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.events.core import EventsCore

    return EventsCore(setup.scenario)


SERVICE = ServiceKind(
    name="events",
    build_spec=events_spec,
    build=_build,
    is_needed=attrgetter("events"),
    position=30,
)
