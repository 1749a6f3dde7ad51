"""Registration and ports of the fields service, known without building its core."""

from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.base.ticks import exact_ticks_from_seconds
from gslcosim.contract import keys
from gslcosim.contract.environment_messages import PROBES, WIND, ProbeSamples, build_source_port
from gslcosim.contract.messages import FieldSamples, FilamentCloud
from gslcosim.contract.participant import Core, ParticipantSpec, Read, Write
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.warmup import warm_up
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import DoorEventSpec, SourceEventSpec, WindChangesSpec
from gslcosim.scenario.models.scenario import list_event_reads


def fields_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the fields' dataflow: poses in, true gas and wind at mounts and probes and snapshots of the cloud out."""
    snapshot_ticks = exact_ticks_from_seconds(
        scenario.recording.gas_every_s, scenario.tick_ns, name="recording.gas_every_s"
    )
    wind = (Read(port=WIND, delay_ticks=1),) if scenario.has_driven_wind else ()
    rates = tuple(Read(port=build_source_port(i), delay_ticks=1) for i in scenario.driven_sources)
    events = list_event_reads(scenario, SourceEventSpec, WindChangesSpec, DoorEventSpec)
    probes = (Write(port=PROBES, message_type=ProbeSamples),) if scenario.probes else ()
    return ParticipantSpec(
        name="fields",
        reads=(Read(port=keys.BODIES), *wind, *rates, *events),
        writes=(
            Write(port=keys.SAMPLES, message_type=FieldSamples),
            Write(port=keys.FILAMENTS, message_type=FilamentCloud, period_ticks=snapshot_ticks, is_for_recording=True),
            *probes,
        ),
    )


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.fields.core import FieldsCore

    return warm_up(FieldsCore(setup.scenario, setup.environment), setup.scenario)


def _check_host(setup: RunSetup) -> None:
    folder = setup.scenario.gas.stored_folder
    if folder is not None and not Path(folder).exists():
        raise UsageError(
            "gas.playback.folder: expected the stored gas on the host of fields, found none. Copy it to the same "
            f"place, or leave fields with the supervisor.\nFolder: {folder}"
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
