"""Which participants a scenario needs, how they are wired, and how each core is built."""

import json
from dataclasses import dataclass
from pathlib import Path

import yaml

from gslcosim.contract import keys
from gslcosim.contract.messages import Command
from gslcosim.contract.participant import Core, Episode, ParticipantSpec, Read, Write
from gslcosim.environment.model import Environment
from gslcosim.environment.store import MESHES_FILE, load_environment
from gslcosim.runtime.agents.door import door_name
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.rehearsal import REHEARSED, rehearse
from gslcosim.runtime.run_dir import RunDir
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec

RECORDER = "recorder"
RADIO = "radio"
CAMERAS = "cameras"


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What every core of a run is built from."""

    run_dir: RunDir
    scenario: Scenario
    environment_dir: Path
    environment: Environment

    @property
    def episode(self) -> Episode:
        """The episode that the run flies."""
        return Episode(seed=self.scenario.seed)

    def save(self) -> None:
        """Write `setup.json` beside the resolved scenario, for the services of the run."""
        self.run_dir.setup.write_text(json.dumps({"environment": str(self.environment_dir)}) + "\n")

    @classmethod
    def load(cls, path: Path) -> "Setup":
        """Read what `save` wrote into a run directory."""
        run_dir = RunDir(path)
        scenario = Scenario.model_validate(yaml.safe_load(run_dir.scenario.read_text()))
        environment_dir = Path(json.loads(run_dir.setup.read_text())["environment"])
        return cls(
            run_dir=run_dir,
            scenario=scenario,
            environment_dir=environment_dir,
            environment=load_environment(environment_dir),
        )


def door_spec(agent: AgentSpec) -> ParticipantSpec:
    """Return the dataflow of an agent behind its door: observations in, checked commands out.

    An agent that is asked only at its waypoints writes where the world announces it.
    """
    announced_in = None if agent.is_asked_every_tick else keys.BODIES
    return ParticipantSpec(
        name=door_name(agent.name),
        reads=(Read(port=keys.observation(agent.name)),),
        writes=(Write(port=keys.command(agent.name), message_type=Command, announced_in=announced_in),),
    )


def service_names(scenario: Scenario) -> tuple[str, ...]:
    """Return the services a run needs, from upstream to downstream."""
    radio = (RADIO,) if scenario.channels else ()
    recorder = (RECORDER,) if scenario.recording.enabled else ()
    cameras = (CAMERAS,) if scenario.cameras else ()
    return ("world", "fields", *radio, *cameras, "sensing", "referee", *recorder)


def dataflow_of(scenario: Scenario) -> Dataflow:
    """Return the checked dataflow of a run.

    Raises:
        DataflowError: it cannot run; see `Dataflow`.
    """
    from gslcosim.cameras.ports import cameras_spec
    from gslcosim.fields.ports import fields_spec
    from gslcosim.radio.ports import radio_spec
    from gslcosim.recording.ports import recorder_spec
    from gslcosim.referee.ports import referee_spec
    from gslcosim.sensing.ports import sensing_spec
    from gslcosim.world.ports import world_spec

    specs = {
        "world": world_spec,
        "fields": fields_spec,
        RADIO: radio_spec,
        CAMERAS: cameras_spec,
        "sensing": sensing_spec,
        "referee": referee_spec,
        RECORDER: recorder_spec,
    }
    services = tuple(specs[name](scenario) for name in service_names(scenario))
    return Dataflow((*services, *(door_spec(agent) for agent in scenario.agents)))


def build_core(name: str, setup: Setup) -> Core:
    """Build the core of a service, with all its kernels loaded; only what this service needs is imported."""
    core = _build(name, setup)
    if name in REHEARSED:
        rehearse(core, setup.scenario)
    return core


def _build(name: str, setup: Setup) -> Core:
    if name == "world":
        from gslcosim.world.core import WorldCore

        return WorldCore(setup.scenario, setup.environment)
    if name == "fields":
        from gslcosim.fields.core import FieldsCore

        return FieldsCore(setup.scenario, setup.environment)
    if name == RADIO:
        from gslcosim.radio.core import RadioCore

        return RadioCore(setup.scenario)
    if name == CAMERAS:
        from gslcosim.cameras.core import CamerasCore

        return CamerasCore(setup.scenario, setup.environment)
    if name == "sensing":
        from gslcosim.sensing.core import SensingCore

        return SensingCore(setup.scenario, setup.environment)
    if name == "referee":
        from gslcosim.referee.core import RefereeCore

        return RefereeCore(setup.scenario, setup.environment)
    if name == RECORDER:
        from gslcosim.recording.core import RecorderCore

        return RecorderCore(setup.scenario, _with_meshes(setup), setup.run_dir.recording)
    raise KeyError(name)


# The meshes of somebody's own geometry, which pictures need and no other core.
def _with_meshes(setup: Setup) -> Environment:
    has_meshes = (setup.environment_dir / MESHES_FILE).is_file()
    return load_environment(setup.environment_dir, with_meshes=True) if has_meshes else setup.environment
