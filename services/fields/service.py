"""Registration of the fields service."""

from gslcosim.contract.participant import Core
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim_services.fields.ports import fields_spec


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.fields.core import FieldsCore

    return FieldsCore(setup.scenario, setup.environment)


SERVICE = ServiceKind(
    name="fields",
    build_spec=fields_spec,
    build=_build,
    is_warmed_up=True,
    preloads=("gslcosim_services.fields.core",),
    position=20,
)
