"""Ports of the recorder, known without building its core (and without importing rerun)."""

from gslcosim.contract import keys
from gslcosim.contract.environment_messages import WIND
from gslcosim.contract.participant import ParticipantSpec, Read
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import list_event_reads
from gslcosim.scenario.models.events import EventSpec

# The recorder may lag far behind: nobody waits for it until its buffers would grow without bound.
RECORDER_WINDOW_TICKS = 512


def recorder_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the recorder's dataflow: everything in, nothing out."""
    reads = [keys.BODIES, keys.SAMPLES, keys.FILAMENTS, keys.SCORE, keys.VERDICT]
    if scenario.channels:
        reads.append(keys.RADIO)
    for agent in scenario.agents:
        reads += [keys.observation(agent.name), keys.command(agent.name)]
    if scenario.has_driven_wind:
        reads.append(WIND)
    reads += scenario.curve_ports
    return ParticipantSpec(
        name="recorder",
        reads=(*(Read(port=port) for port in reads), *list_event_reads(scenario, EventSpec)),
        writes=(),
        window_ticks=RECORDER_WINDOW_TICKS,
    )
