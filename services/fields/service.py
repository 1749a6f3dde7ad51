"""Registration of the fields service."""

from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.contract.participant import Core
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim_services.fields.ports import fields_spec


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.fields.core import FieldsCore

    return FieldsCore(setup.scenario, setup.environment)


def _check_host(setup: RunSetup) -> None:
    stored = setup.scenario.gas.stored
    if stored is not None and not Path(stored.folder).exists():
        raise UsageError(
            "gas.playback.folder: expected the stored gas on the host of fields, found none. Copy it to the same "
            f"place, or leave fields with the supervisor.\nFolder: {stored.folder}"
        )


SERVICE = ServiceKind(
    name="fields",
    build_spec=fields_spec,
    build=_build,
    is_warmed_up=True,
    has_most_kernels=True,
    preloads=("gslcosim_services.fields.core",),
    position=20,
    check_host=_check_host,
)
