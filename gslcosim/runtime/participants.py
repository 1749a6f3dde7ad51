"""The one list of services: what each is, when a run needs it, and how its core is built.

Assembly, the order of digests, rehearsals and the processes of a run come from it; compose.yaml and the pages are held
to it by tests. Agents are the other participants of a run; each stands behind a door.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import singledispatch

from gslcosim.cameras.ports import cameras_spec
from gslcosim.contract.participant import Core, ParticipantSpec
from gslcosim.environment.model import Environment
from gslcosim.environment.store import MESHES_FILE, load_environment
from gslcosim.errors import UsageError
from gslcosim.events.ports import events_spec
from gslcosim.fields.ports import fields_spec
from gslcosim.radio.ports import radio_spec
from gslcosim.recording.ports import recorder_spec
from gslcosim.referee.ports import referee_spec
from gslcosim.runtime.agents.door import DOOR_PREFIX
from gslcosim.runtime.foreign.declared import foreign_spec
from gslcosim.runtime.setup import Setup
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.own_models import OwnModelSpec
from gslcosim.scenario.models.services import ServiceSpec
from gslcosim.sensing.ports import sensing_spec
from gslcosim.world.ports import world_spec


@dataclass(frozen=True, kw_only=True)
class ServiceKind:
    """A participant that is a process of its own where a run has processes.

    `name` is that of the participant, its folder and its part of keys. `spec_of` tells its reads and writes without
    building it; `build` imports and builds its core, and nothing of another service. `is_needed` says whether a
    scenario has it. `is_rehearsed` ones have kernels to load before time passes; `preloads` are modules that a process
    may import before it is forked, as they start no threads; `import_early` imports what takes long and may start some,
    in a process that will be this service and nothing else; `follows_agents` ones read what agents command in the same
    tick, and so stand downstream of them.
    """

    name: str
    spec_of: Callable[[Scenario], ParticipantSpec]
    build: Callable[[Setup], Core]
    is_needed: Callable[[Scenario], bool] = lambda scenario: True
    is_rehearsed: bool = False
    preloads: tuple[str, ...] = ()
    import_early: Callable[[], None] | None = None
    follows_agents: bool = False


def _world(setup: Setup) -> Core:
    from gslcosim.world.core import WorldCore

    return WorldCore(setup.scenario, setup.environment)


def _fields(setup: Setup) -> Core:
    from gslcosim.fields.core import FieldsCore

    return FieldsCore(setup.scenario, setup.environment)


def _events(setup: Setup) -> Core:
    from gslcosim.events.core import EventsCore

    return EventsCore(setup.scenario)


def _radio(setup: Setup) -> Core:
    from gslcosim.radio.core import RadioCore

    return RadioCore(setup.scenario)


def _cameras(setup: Setup) -> Core:
    from gslcosim.cameras.core import CamerasCore

    return CamerasCore(setup.scenario, setup.environment)


def _sensing(setup: Setup) -> Core:
    from gslcosim.sensing.core import SensingCore

    return SensingCore(setup.scenario, setup.environment)


def _referee(setup: Setup) -> Core:
    from gslcosim.referee.core import RefereeCore

    return RefereeCore(setup.scenario, setup.environment)


def _recorder(setup: Setup) -> Core:
    from gslcosim.recording.core import RecorderCore

    return RecorderCore(setup.scenario, _with_meshes(setup), setup.run_dir.recording)


def _import_for_recorder() -> None:
    from gslcosim.recording.learning_early import import_early

    import_early()


# The meshes of somebody's own geometry, which pictures need and no other core.
def _with_meshes(setup: Setup) -> Environment:
    has_meshes = (setup.environment_dir / MESHES_FILE).is_file()
    return load_environment(setup.environment_dir, with_meshes=True) if has_meshes else setup.environment


SERVICES = (
    ServiceKind(
        name="world",
        spec_of=world_spec,
        build=_world,
        is_rehearsed=True,
        preloads=("gslcosim.world.core",),
    ),
    ServiceKind(
        name="fields", spec_of=fields_spec, build=_fields, is_rehearsed=True, preloads=("gslcosim.fields.core",)
    ),
    ServiceKind(name="events", spec_of=events_spec, build=_events, is_needed=lambda scenario: bool(scenario.events)),
    ServiceKind(name="radio", spec_of=radio_spec, build=_radio, is_needed=lambda scenario: bool(scenario.channels)),
    ServiceKind(
        name="cameras", spec_of=cameras_spec, build=_cameras, is_needed=lambda scenario: bool(scenario.cameras)
    ),
    ServiceKind(
        name="sensing", spec_of=sensing_spec, build=_sensing, is_rehearsed=True, preloads=("gslcosim.sensing.core",)
    ),
    ServiceKind(
        name="referee",
        spec_of=referee_spec,
        build=_referee,
        preloads=("gslcosim.referee.core",),
        follows_agents=True,
    ),
    ServiceKind(
        name="recorder",
        spec_of=recorder_spec,
        build=_recorder,
        is_needed=lambda scenario: scenario.recording.enabled,
        import_early=_import_for_recorder,
        follows_agents=True,
    ),
)
"""All services of gslcosim's own, from upstream to downstream."""


@singledispatch
def service_of(block: ServiceSpec) -> ServiceKind:
    """Return the service that a block of `services` in a scenario names, by what is registered for the block's type.

    A third party registers a function of its block where it defines it: `service_of.register(ItsBlock, its_service)`.

    Raises:
        UsageError: nothing is registered for such a block.
    """
    raise UsageError(
        f"services: expected a service for {block.name!r}, found none. Register one for {type(block).__name__} with "
        "gslcosim.runtime.participants.service_of."
    )


def services_of(scenario: Scenario) -> tuple[ServiceKind, ...]:
    """Return the services that a run needs, from upstream to downstream, those of other packages, and own models.

    Raises:
        UsageError: a package's service has the name of one of gslcosim's, or is called otherwise than its block.
    """
    others = tuple(service_of(block) for block in scenario.services)
    own_models = tuple(_own_model(own) for own in scenario.participants)
    for block, kind in zip(scenario.services, others, strict=True):
        if kind.name != block.name or kind.name in {own.name for own in SERVICES}:
            raise UsageError(
                f"services: expected a service called {block.name!r}, and like none of gslcosim's own, was "
                f"{kind.name!r}. Correct the package."
            )
    return (*(kind for kind in SERVICES if kind.is_needed(scenario)), *others, *own_models)


# A program of the user's own, behind a core that speaks with it.
def _own_model(own: OwnModelSpec) -> ServiceKind:
    def build(setup: Setup) -> Core:
        from gslcosim.runtime.assembly import dataflow_of
        from gslcosim.runtime.foreign.foreign_core import ForeignCore

        types = dataflow_of(setup.scenario).message_types
        return ForeignCore(own, setup, {port: message_type.__name__ for port, message_type in types.items()})

    return ServiceKind(name=own.name, spec_of=lambda scenario: foreign_spec(own, scenario), build=build)


def service_kind(name: str, scenario: Scenario) -> ServiceKind:
    """Return the service of a name.

    Raises:
        UsageError: the run has none of that name.
    """
    kinds = {kind.name: kind for kind in services_of(scenario)}
    if name not in kinds:
        raise UsageError(f"service: expected one of {', '.join(kinds)}, which this run has, was {name!r}.")
    return kinds[name]


def upstream_rank(participant: str) -> tuple[int, int]:
    """Return what sorts participants from upstream to downstream: causes before consequences within a tick.

    Args:
        participant: The name of a service or of an agent's door; an unknown one sorts last.
    """
    if participant.startswith(DOOR_PREFIX):
        return (1, 0)
    for i, kind in enumerate(SERVICES):
        if kind.name == participant:
            return (2 if kind.follows_agents else 0, i)
    return (3, 0)
