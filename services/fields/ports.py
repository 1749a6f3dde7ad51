"""Ports of the fields service, known without building its core."""

from gslcosim.base.ticks import exact_ticks_from_seconds
from gslcosim.contract import keys
from gslcosim.contract.environment_messages import WIND
from gslcosim.contract.messages import FieldSamples, FilamentCloud
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import list_event_reads
from gslcosim.scenario.models.events import DoorEventSpec, SourceEventSpec, WindChangesSpec


def fields_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the fields' dataflow: poses in, true gas and wind at the mounts and snapshots of the cloud out."""
    snapshot_ticks = exact_ticks_from_seconds(
        scenario.recording.gas_every_s, scenario.tick_ns, name="recording.gas_every_s"
    )
    wind = (Read(port=WIND, delay_ticks=1),) if scenario.has_driven_wind else ()
    events = list_event_reads(scenario, SourceEventSpec, WindChangesSpec, DoorEventSpec)
    return ParticipantSpec(
        name="fields",
        reads=(Read(port=keys.BODIES), *wind, *events),
        writes=(
            Write(port=keys.SAMPLES, message_type=FieldSamples),
            Write(port=keys.FILAMENTS, message_type=FilamentCloud, period_ticks=snapshot_ticks, is_for_recording=True),
        ),
    )
