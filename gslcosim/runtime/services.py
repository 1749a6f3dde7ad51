"""Registry of services: when a run needs each, how its core is built, its dataflow, and shared processes.

They come from entry points, so that nothing here imports one of them. Assembly, the order of digests, warm-ups and
the processes of a run come from here; compose.yaml and the pages are held to it by tests. Agents are the other
participants of a run; each has a session.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, singledispatch
from pathlib import Path

from gslcosim.base.errors import DataflowError, UsageError
from gslcosim.base.extensions import list_registered
from gslcosim.base.problems import Problem
from gslcosim.contract import keys
from gslcosim.contract.messages import Briefing, Command
from gslcosim.contract.participant import (
    AGENT_PREFIX,
    WINDOW_TICKS,
    Core,
    ParticipantSpec,
    Read,
    Write,
    get_agent_participant,
)
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.external.protocol import build_external_spec, find_declaration_problems
from gslcosim.runtime.network import Network
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.participants import ParticipantProgramSpec, ServiceSpec
from gslcosim.scenario.models.scenario import AgentSpec, Processes

ServiceGroup = tuple[str, ...]
# Services of this distribution and of extensions; a block of the same name in a scenario's `services` replaces one.
DEFAULT_SERVICES_GROUP = "gslcosim.default_services"


def group_services(processes: Processes, services: Sequence[str]) -> tuple[ServiceGroup, ...]:
    """Return the services of each process of a run, both from upstream to downstream.

    Args:
        processes: `separate`, `grouped`, or lists of services that share a process; the rest are then separate.
        services: Those of the run, from upstream to downstream.
    """
    if processes == "separate":
        return tuple((name,) for name in services)
    if processes in ("grouped", "one"):
        return (tuple(services),)
    named = [name for group in processes for name in group]
    wrong = [name for name in named if name not in services or named.count(name) > 1]
    if wrong:
        raise UsageError(
            f"processes: expected each service at most once, of {', '.join(services)}, was {wrong[0]!r}"
            f"{', twice' if wrong[0] in services else ''}."
        )
    groups = [tuple(sorted(group, key=services.index)) for group in processes if group]
    groups += [(name,) for name in services if name not in named]
    return tuple(sorted(groups, key=lambda group: services.index(group[0])))


def get_process_name(group: ServiceGroup) -> str:
    """Return the name of the process of a group, which is that of its log too."""
    return "+".join(group)


@dataclass(frozen=True, kw_only=True)
class ServiceKind:
    """A participant that is a process of its own where a run has processes.

    `name` is that of the participant, its folder and its part of keys. `build_spec`` gives its reads and writes without
    building it; `build` imports and builds its core, and nothing of another service, with all its kernels loaded:
    `is_warmed_up` says that it has some, which `gslcosim.runtime.warmup` loads, and the one that `has_most_kernels` is
    built first where one process compiles for all. `is_needed` gives something true where a scenario has it; `preloads`
    are modules that a process may import before it is forked, as they start no threads; `import_early` imports what
    takes long and may start some, in a process that will be this service and nothing else; `follows_agents` ones read
    what agents command in the same tick, and so stand downstream of them.

    `position` orders services from upstream to downstream. `build_briefings` returns the briefing of each agent before
    the
    first tick, for runs that start at a snapshot, in which agents are briefed before the service runs. `repair` makes
    whole what a service that was killed has left in the run's folder; it raises `RecordingError` or `OSError`.
    `check_host` raises `UsageError` where a host that joins a run lacks files that the service reads from a place of
    their own.
    """

    name: str
    build_spec: Callable[[Scenario], ParticipantSpec]
    build: Callable[[RunSetup], Core]
    is_needed: Callable[[Scenario], object] = lambda scenario: True
    is_warmed_up: bool = False
    has_most_kernels: bool = False
    preloads: tuple[str, ...] = ()
    import_early: Callable[[], None] | None = None
    follows_agents: bool = False
    position: int = 100
    build_briefings: Callable[[RunSetup], Mapping[str, Briefing]] | None = None
    repair: Callable[[Path], None] | None = None
    check_host: Callable[[RunSetup], None] | None = None


@cache
def default_services() -> tuple[ServiceKind, ...]:
    """Return the services that a run has if it needs them, from upstream to downstream, from their entry points."""
    found: list[ServiceKind] = []
    for point in list_registered(DEFAULT_SERVICES_GROUP):
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


@singledispatch
def get_block_service(block: ServiceSpec) -> ServiceKind:
    """Return the service that a block of `services` in a scenario names, by what is registered for the block's type.

    A third party registers a function of its block where it defines it:
    `get_block_service.register(ItsBlock, its_service)`.
    """
    raise UsageError(
        f"services: expected a service for {block.name!r}, found none. Register one for {type(block).__name__} with "
        "gslcosim.runtime.services.get_block_service."
    )


def list_services(scenario: Scenario) -> tuple[ServiceKind, ...]:
    """Return the services that a run needs, from upstream to downstream, those of other packages, and own models.

    A block of `services` whose name is that of one of gslcosim's own services replaces it.
    """
    others = {block.name: get_block_service(block) for block in scenario.services}
    own_models = tuple(_build_external_kind(own) for own in scenario.participants)
    for name, kind in others.items():
        if kind.name != name:
            raise UsageError(f"services: expected a service called {name!r}, was {kind.name!r}. Correct the package.")
    defaults = [
        others.pop(kind.name, kind) for kind in default_services() if kind.name in others or kind.is_needed(scenario)
    ]
    return (*defaults, *others.values(), *own_models)


# The user's own program, or one that an extension starts, behind a core that exchanges messages with it.
def _build_external_kind(own: ParticipantProgramSpec) -> ServiceKind:
    def build(setup: RunSetup) -> Core:
        # its imports are of this module
        from gslcosim.runtime.external.core import ExternalCore

        types = build_dataflow(setup.scenario).message_types
        if (start := own.start.registered) is not None:
            return start.build_core(own, setup, types)
        return ExternalCore(own, setup, {port: message_type.__name__ for port, message_type in types.items()})

    return ServiceKind(name=own.name, build_spec=lambda scenario: build_external_spec(own, scenario), build=build)


def find_service(name: str, scenario: Scenario) -> ServiceKind:
    """Return the service of a name."""
    kinds = {kind.name: kind for kind in list_services(scenario)}
    if name not in kinds:
        raise UsageError(f"service: expected one of {', '.join(kinds)}, which this run has, was {name!r}.")
    return kinds[name]


def get_upstream_rank(participant: str) -> tuple[int, int]:
    """Return the key that sorts participants from upstream to downstream: causes before effects within a tick.

    Args:
        participant: The name of a service or of an agent's session; an unknown one sorts last.
    """
    if participant.startswith(AGENT_PREFIX):
        return (1, 0)
    for i, kind in enumerate(default_services()):
        if kind.name == participant:
            return (2 if kind.follows_agents else 0, i)
    return (3, 0)


def build_agent_spec(agent: AgentSpec) -> ParticipantSpec:
    """Return the dataflow of an agent's session: observations in, checked commands out.

    An agent that is waited for only at its waypoints writes where the world announces it.
    """
    announced_in = keys.BODIES if agent.mode_name == "on_request" else None
    return ParticipantSpec(
        name=get_agent_participant(agent.name),
        reads=(Read(port=keys.observation(agent.name)),),
        writes=(Write(port=keys.command(agent.name), message_type=Command, announced_in=announced_in),),
    )


def list_service_names(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the services that a run needs, from upstream to downstream."""
    return tuple(kind.name for kind in list_services(scenario))


def build_dataflow(scenario: Scenario, *, window_ticks: int | None = None) -> Dataflow:
    """Return the checked dataflow of a run.

    Args:
        window_ticks: Lead that a writer may have over an ordinary reader; the windows of other readers, larger or
            smaller, change in proportion. Absent: the window that each reader states.
    """
    specs = _build_specs(scenario)
    if window_ticks is None:
        return Dataflow(specs)
    windows = (max(1, spec.window_ticks * window_ticks // WINDOW_TICKS) for spec in specs)
    return Dataflow(tuple(replace(spec, window_ticks=window) for spec, window in zip(specs, windows, strict=True)))


def plan_processes(scenario: Scenario, processes: Processes, network: Network) -> tuple[ServiceGroup, ...]:
    """Return the services of each process of a run, from upstream to downstream; those elsewhere come last.

    With the processes `one` there are no others than this one.
    """
    services = list_service_names(scenario)
    build_dataflow(scenario)
    network.check(services, is_one_process=processes == "one")
    if processes == "one":
        return ()
    here = [name for name in services if not network.is_remote(name)]
    elsewhere = ((name,) for name in services if name not in here)
    return (*(group_services(processes, here) if here else ()), *elsewhere)


def find_service_problems(scenario: Scenario, directory: Path) -> Iterable[Problem]:
    """Return the problems that keep services of other packages, and a scenario's own models, from running."""
    del directory
    try:
        if problems := [*find_participant_problems(scenario)]:
            return problems
        build_dataflow(scenario)
    except UsageError as error:
        found = ", ".join(f"'{block.name}'" for block in scenario.services)
        remedy = str(error).removeprefix("services: ")
        return [Problem(where="services", expected="services that their packages bring", found=found, remedy=remedy)]
    except DataflowError as error:
        expected = "services whose reads and writes fit together"
        remedy = " ".join(str(error).split())
        found = ", ".join(f"'{block.name}'" for block in scenario.services)
        return [Problem(where="services", expected=expected, found=found, remedy=remedy)]
    return ()


def find_participant_problems(scenario: Scenario) -> Iterable[Problem]:
    """Return the problems of the user's own models in a scenario, besides those in their own blocks."""
    if not scenario.participants:
        return ()
    return find_declaration_problems(scenario, [kind.name for kind in default_services()], _build_specs(scenario))


def _build_specs(scenario: Scenario) -> tuple[ParticipantSpec, ...]:
    services = (kind.build_spec(scenario) for kind in list_services(scenario))
    return (*services, *(build_agent_spec(agent) for agent in scenario.agents))


def build_core(name: str, setup: RunSetup) -> Core:
    """Build the core of a service, with all its kernels loaded; only what this service needs is imported."""
    return find_service(name, setup.scenario).build(setup)


def build_all_cores(setup: RunSetup) -> tuple[Dataflow, list[Core]]:
    """Return the dataflow of a run and the cores of all its services, from upstream to downstream."""
    dataflow = build_dataflow(setup.scenario)
    kinds = {kind.name: kind for kind in list_services(setup.scenario)}
    return dataflow, [kinds[name].build(setup) for name in dataflow.order if name in kinds]
