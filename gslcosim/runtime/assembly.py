"""How the participants of a run are wired, and how the core of a service is built."""

from collections.abc import Iterable
from dataclasses import replace

from gslcosim.contract import keys
from gslcosim.contract.messages import Command
from gslcosim.contract.participant import WINDOW_TICKS, Core, ParticipantSpec, Read, Write
from gslcosim.runtime.agents.door import door_name
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.foreign.declared import problems_of_participants
from gslcosim.runtime.participants import default_services, service_kind, services_of
from gslcosim.runtime.rehearsal import rehearse
from gslcosim.runtime.setup import Setup
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.problems import Problem


def door_spec(agent: AgentSpec) -> ParticipantSpec:
    """Return the dataflow of an agent behind its door: observations in, checked commands out.

    An agent that is waited for only at its waypoints writes where the world announces it.
    """
    announced_in = keys.BODIES if agent.mode_name == "on_request" else None
    return ParticipantSpec(
        name=door_name(agent.name),
        reads=(Read(port=keys.observation(agent.name)),),
        writes=(Write(port=keys.command(agent.name), message_type=Command, announced_in=announced_in),),
    )


def service_names(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the services that a run needs, from upstream to downstream."""
    return tuple(kind.name for kind in services_of(scenario))


def dataflow_of(scenario: Scenario, *, window_ticks: int | None = None) -> Dataflow:
    """Return the checked dataflow of a run.

    Args:
        scenario: What is flown.
        window_ticks: How far a writer may run ahead of an ordinary reader; the windows of others, which are larger or
            smaller, change in proportion. Absent: as each reader says.

    Raises:
        DataflowError: it cannot run; see `Dataflow`.
    """
    specs = _specs_of(scenario)
    if window_ticks is None:
        return Dataflow(specs)
    windows = (max(1, spec.window_ticks * window_ticks // WINDOW_TICKS) for spec in specs)
    return Dataflow(tuple(replace(spec, window_ticks=window) for spec, window in zip(specs, windows, strict=True)))


def participant_problems(scenario: Scenario) -> Iterable[Problem]:
    """Return what is wrong with the models of the user's own in a scenario, beside their own blocks."""
    if not scenario.participants:
        return ()
    return problems_of_participants(scenario, [kind.name for kind in default_services()], _specs_of(scenario))


def _specs_of(scenario: Scenario) -> tuple[ParticipantSpec, ...]:
    services = (kind.spec_of(scenario) for kind in services_of(scenario))
    return (*services, *(door_spec(agent) for agent in scenario.agents))


def build_core(name: str, setup: Setup) -> Core:
    """Build the core of a service, with all its kernels loaded; only what this service needs is imported.

    Raises:
        UsageError: the run has no such service.
    """
    kind = service_kind(name, setup.scenario)
    core = kind.build(setup)
    if kind.is_rehearsed:
        rehearse(core, setup.scenario)
    return core
