"""Registration, ports and preload of the recorder, known without importing rerun."""

import importlib
import sys
from operator import attrgetter
from pathlib import Path

from gslcosim.contract import keys
from gslcosim.contract.environment_messages import WIND
from gslcosim.contract.participant import Core, ParticipantSpec, Read
from gslcosim.environment.store import MESHES_FILE, load_environment
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import EventSpec
from gslcosim.scenario.models.scenario import list_event_reads

# The recorder may lag far behind: writers wait for it only when its buffers would grow without bound.
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


def preload_modules() -> None:
    """Import all modules of the recorder, in a process of its own.

    It may start threads.
    """
    _block_pandas()
    for module in ("blueprint", "recording_file", "rows.events", "run_recording"):
        importlib.import_module(f"gslcosim_services.recorder.{module}")


# pyarrow imports pandas, if installed, at its first conversion of a list: 0.2 s and 50 MB for nothing. It keeps the
# result of that import, so that a process with a user's code must not call this.
def _block_pandas() -> None:
    import pyarrow

    sys.meta_path.insert(0, _PandasBlocker)
    try:
        pyarrow.array([True])
    finally:
        sys.meta_path.remove(_PandasBlocker)


class _PandasBlocker:
    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        del path, target
        if name == "pandas":
            raise ModuleNotFoundError(name=name)


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.recorder.core import RecorderCore

    # The meshes of imported geometry, which only the recording's room needs.
    has_meshes = (setup.environment_dir / MESHES_FILE).is_file()
    environment = load_environment(setup.environment_dir, with_meshes=True) if has_meshes else setup.environment
    return RecorderCore(setup.scenario, environment, setup.run_dir.recording)


def _repair(recording: Path) -> None:
    from gslcosim_services.recorder.rerun_cli import repair_recording

    repair_recording(recording)


SERVICE = ServiceKind(
    name="recorder",
    build_spec=recorder_spec,
    build=_build,
    is_needed=attrgetter("recording.enabled"),
    import_early=preload_modules,
    follows_agents=True,
    position=80,
    repair=_repair,
)
