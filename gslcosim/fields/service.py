"""Registration of the fields service."""

from gslcosim.contract.participant import Core
from gslcosim.fields.ports import fields_spec
from gslcosim.runtime.participants import ServiceKind
from gslcosim.runtime.setup import Setup


def _build(setup: Setup) -> Core:
    from gslcosim.fields.core import FieldsCore

    return FieldsCore(setup.scenario, setup.environment)


SERVICE = ServiceKind(
    name="fields",
    spec_of=fields_spec,
    build=_build,
    is_rehearsed=True,
    preloads=("gslcosim.fields.core",),
    position=20,
)
