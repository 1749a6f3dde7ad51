"""Registration of the recorder service."""

from pathlib import Path

from gslcosim.contract.participant import Core
from gslcosim.environment.model import Environment
from gslcosim.environment.store import MESHES_FILE, load_environment
from gslcosim.recording.ports import recorder_spec
from gslcosim.runtime.participants import ServiceKind
from gslcosim.runtime.setup import Setup


def _build(setup: Setup) -> Core:
    from gslcosim.recording.core import RecorderCore

    return RecorderCore(setup.scenario, _load_meshes(setup), setup.run_dir.recording)


# The meshes of somebody's own geometry, which pictures need and no other core.
def _load_meshes(setup: Setup) -> Environment:
    has_meshes = (setup.environment_dir / MESHES_FILE).is_file()
    return load_environment(setup.environment_dir, with_meshes=True) if has_meshes else setup.environment


def _import_early() -> None:
    from gslcosim.recording.learning_early import import_early

    import_early()


def _repair(recording: Path) -> None:
    from gslcosim.recording.repair import repair_recording

    repair_recording(recording)


SERVICE = ServiceKind(
    name="recorder",
    spec_of=recorder_spec,
    build=_build,
    is_needed=lambda scenario: scenario.recording.enabled,
    import_early=_import_early,
    follows_agents=True,
    position=80,
    repair=_repair,
)
