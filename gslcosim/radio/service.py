"""Registration of the radio service."""

from gslcosim.contract.participant import Core
from gslcosim.radio.ports import radio_spec
from gslcosim.runtime.participants import ServiceKind
from gslcosim.runtime.setup import Setup


def _build(setup: Setup) -> Core:
    from gslcosim.radio.core import RadioCore

    return RadioCore(setup.scenario)


SERVICE = ServiceKind(
    name="radio",
    spec_of=radio_spec,
    build=_build,
    is_needed=lambda scenario: bool(scenario.channels),
    position=40,
)
