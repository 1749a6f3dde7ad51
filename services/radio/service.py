"""Registration of the radio service."""

from operator import attrgetter

from gslcosim.contract.participant import Core
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim_services.radio.ports import radio_spec


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.radio.core import RadioCore

    return RadioCore(setup.scenario)


SERVICE = ServiceKind(
    name="radio",
    build_spec=radio_spec,
    build=_build,
    is_needed=attrgetter("channels"),
    position=40,
)
