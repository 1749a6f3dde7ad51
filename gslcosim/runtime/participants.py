"""Services of a run: what each is, when a run needs it, and how its core is built.

They come from entry points, so that nothing here imports one of them. Assembly, the order of digests, rehearsals and
the processes of a run come from here; compose.yaml and the pages are held to it by tests. Agents are the other
participants of a run; each stands behind a door.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, singledispatch
from importlib.metadata import EntryPoint, distributions
from pathlib import Path

from gslcosim.contract.messages import Briefing
from gslcosim.contract.participant import Core, ParticipantSpec
from gslcosim.errors import UsageError
from gslcosim.runtime.agents.door import DOOR_PREFIX
from gslcosim.runtime.foreign.declared import foreign_spec
from gslcosim.runtime.setup import Setup
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.own_models import OwnModelSpec
from gslcosim.scenario.models.services import ServiceSpec


@dataclass(frozen=True, kw_only=True)
class ServiceKind:
    """A participant that is a process of its own where a run has processes.

    `name` is that of the participant, its folder and its part of keys. `spec_of` tells its reads and writes without
    building it; `build` imports and builds its core, and nothing of another service. `is_needed` says whether a
    scenario has it. `is_rehearsed` ones have kernels to load before time passes; `preloads` are modules that a process
    may import before it is forked, as they start no threads; `import_early` imports what takes long and may start some,
    in a process that will be this service and nothing else; `follows_agents` ones read what agents command in the same
    tick, and so stand downstream of them.

    `position` orders services from upstream to downstream. `build_briefings` returns what each agent is told before the
    first tick, for runs that start at a snapshot, in which agents are briefed before the service runs. `repair` makes
    whole what a service that was killed has left in the run's folder; it raises `RecordingError` or `OSError`.
    """

    name: str
    spec_of: Callable[[Scenario], ParticipantSpec]
    build: Callable[[Setup], Core]
    is_needed: Callable[[Scenario], bool] = lambda scenario: True
    is_rehearsed: bool = False
    preloads: tuple[str, ...] = ()
    import_early: Callable[[], None] | None = None
    follows_agents: bool = False
    position: int = 100
    build_briefings: Callable[[Setup], Mapping[str, Briefing]] | None = None
    repair: Callable[[Path], None] | None = None


# What this distribution offers; packages of others replace one by a block of its name in a scenario's `services`.
DEFAULT_SERVICES_GROUP = "gslcosim.default_services"


@cache
def default_services() -> tuple[ServiceKind, ...]:
    """Return the services that a run has where it needs them, from upstream to downstream, from their entry points.

    Raises:
        UsageError: the installation lacks them, or an entry point is no `ServiceKind` of its name.
    """
    found: list[ServiceKind] = []
    for point in _own_entry_points():
        kind: object = point.load()
        if not isinstance(kind, ServiceKind) or kind.name != point.name:
            raise UsageError(
                f"entry point {point.name} of {DEFAULT_SERVICES_GROUP}: expected a ServiceKind of that name, was "
                f"{point.value}. Install gslcosim again."
            )
        found.append(kind)
    if not found:
        raise UsageError(
            f"gslcosim: expected entry points in {DEFAULT_SERVICES_GROUP}, found none. Install gslcosim again: "
            "pip install --force-reinstall --no-deps gslcosim, or --editable . in a checkout."
        )
    return tuple(sorted(found, key=lambda kind: kind.position))


# An older checkout's `*.egg-info`, which comes first in a checkout's own folder, has entry points of its time.
def _own_entry_points() -> Iterable[EntryPoint]:
    installed = (own.entry_points.select(group=DEFAULT_SERVICES_GROUP) for own in distributions(name="gslcosim"))
    return next((points for points in installed if points), ())


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

    A block of `services` whose name is that of one of gslcosim's own services replaces it.

    Raises:
        UsageError: a package's service is called otherwise than its block.
    """
    others = {block.name: service_of(block) for block in scenario.services}
    own_models = tuple(_own_model(own) for own in scenario.participants)
    for name, kind in others.items():
        if kind.name != name:
            raise UsageError(f"services: expected a service called {name!r}, was {kind.name!r}. Correct the package.")
    defaults = [
        others.pop(kind.name, kind) for kind in default_services() if kind.name in others or kind.is_needed(scenario)
    ]
    return (*defaults, *others.values(), *own_models)


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
    for i, kind in enumerate(default_services()):
        if kind.name == participant:
            return (2 if kind.follows_agents else 0, i)
    return (3, 0)
