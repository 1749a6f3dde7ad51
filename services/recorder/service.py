"""Registration of the recorder service."""

from pathlib import Path

from gslcosim.contract.participant import Core
from gslcosim.environment.model import Environment
from gslcosim.environment.store import MESHES_FILE, load_environment
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim_services.recorder.ports import recorder_spec


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.recorder.core import RecorderCore

    return RecorderCore(setup.scenario, _load_meshes(setup), setup.run_dir.recording)


# The meshes of somebody's own geometry, which pictures need and no other core.
def _load_meshes(setup: RunSetup) -> Environment:
    has_meshes = (setup.environment_dir / MESHES_FILE).is_file()
    return load_environment(setup.environment_dir, with_meshes=True) if has_meshes else setup.environment


def _import_early() -> None:
    from gslcosim_services.recorder.preload import preload_modules

    preload_modules()


def _repair(recording: Path) -> None:
    from gslcosim_services.recorder.repair import repair_recording

    repair_recording(recording)


SERVICE = ServiceKind(
    name="recorder",
    build_spec=recorder_spec,
    build=_build,
    is_needed=lambda scenario: scenario.recording.enabled,
    import_early=_import_early,
    follows_agents=True,
    position=80,
    repair=_repair,
)
