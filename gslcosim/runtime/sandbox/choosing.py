"""Which sandboxes this machine has, and which of them an agent of a scenario gets."""

from collections.abc import Mapping
from typing import Literal, Protocol

from gslcosim.errors import UsageError
from gslcosim.runtime.sandbox import landlock, seccomp
from gslcosim.runtime.sandbox.bubblewrap import why_not
from gslcosim.runtime.sandbox.launching import is_launcher_possible
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.confinement import AgentLimitsSpec, SandboxChoice
from gslcosim.scenario.models.scenario import AgentSpec

SandboxKind = Literal["bubblewrap", "landlock", "none"]
IN_THIS_PROCESS = "none: in this process"
STARTED_ELSEWHERE = "none: started elsewhere"


class Confined(Protocol):
    """What a scenario says of how the process of an agent or participant is confined; `place` is for errors."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    @property
    def place(self) -> str:
        """Where it is in the scenario."""
        ...

    @property
    def sandbox(self) -> SandboxChoice:
        """What its process is started in."""
        ...

    @property
    def limits(self) -> AgentLimitsSpec:
        """The bounds of what its processes use."""
        ...

    @property
    def may_read(self) -> tuple[str, ...]:
        """Folders that it sees besides its own."""
        ...

    @property
    def may_write(self) -> tuple[str, ...]:
        """Folders that it may change."""
        ...

    @property
    def environment(self) -> dict[str, str | None] | None:
        """Variables of its environment beside those that every program needs."""
        ...


def why_there_is_no(kind: SandboxKind) -> str:
    """Return what keeps a sandbox from working on this machine, empty when it works."""
    if kind == "none":
        return ""
    if kind == "bubblewrap":
        return why_not()
    if not landlock.version():
        return "this kernel has no Landlock"
    return "" if seccomp.is_possible() else "there is no filter of system calls for this kind of processor"


def strongest_sandbox() -> SandboxKind:
    """Return the strongest sandbox that works on this machine."""
    if not why_there_is_no("bubblewrap"):
        return "bubblewrap"
    return "none" if why_there_is_no("landlock") else "landlock"


def sandboxes_of(scenario: Scenario, *, is_one_process: bool) -> Mapping[str, str]:
    """Return by agent and participant what its process is confined by, in the words of `result.json`.

    Args:
        scenario: The scenario.
        is_one_process: Whether Python agents are objects in this process.

    Raises:
        UsageError: the scenario demands what this machine lacks, or of an agent that is not started as a process.
    """
    starts = {agent.name: agent for agent in scenario.agents}
    of_agents = {
        agent.name: _sandbox_of(starts[agent.process], is_one_process=is_one_process) for agent in scenario.agents
    }
    return {**of_agents, **{participant.name: _sandbox_started(participant) for participant in scenario.participants}}


def is_sandboxed(told: str) -> bool:
    """Return whether words of `sandboxes_of`, or several of them joined by `; `, are all about sandboxes."""
    return bool(told) and not any(each.startswith("none") for each in told.split("; "))


def sandbox_kind(agent: Confined) -> SandboxKind:
    """Return which sandbox the process of an agent or participant is started in.

    Raises:
        UsageError: the one that the scenario demands does not work here.
    """
    if agent.sandbox == "auto":
        return strongest_sandbox()
    if agent.sandbox == "required":
        if (strongest := strongest_sandbox()) == "none":
            raise UsageError(
                f"{agent.place}.sandbox: expected a sandbox on this machine, there is none: "
                f"{why_there_is_no('bubblewrap')}; {why_there_is_no('landlock')}. Install bubblewrap, or take auto."
            )
        return strongest
    if reason := why_there_is_no(agent.sandbox):
        raise UsageError(
            f"{agent.place}.sandbox: expected {agent.sandbox} on this machine, but {reason}. Install it, or take "
            "auto for the strongest that works here; `gslcosim doctor` says which that is."
        )
    return agent.sandbox


def _sandbox_of(agent: AgentSpec, *, is_one_process: bool) -> str:
    is_object = is_one_process and not agent.start.is_behind_gateway
    if agent.start.attach or is_object:
        _check_nothing_is_demanded(agent)
        return STARTED_ELSEWHERE if agent.start.attach else IN_THIS_PROCESS
    return _sandbox_started(agent)


def _sandbox_started(agent: Confined) -> str:
    kind = sandbox_kind(agent)
    if agent.limits.are_given and not is_launcher_possible():
        raise UsageError(f"{agent.place}.limits: expected Linux for limits, was another system. Leave them out.")
    gaps = open_gaps(kind)
    name = f"landlock {landlock.version()}" if kind == "landlock" else kind
    return f"{name} (open: {', '.join(gaps)})" if gaps else name


def open_gaps(kind: SandboxKind) -> list[str]:
    """Return in words what a sandbox leaves open on this machine that it closes on others."""
    if kind == "landlock":
        return landlock.missing_protections(landlock.version())
    if kind == "bubblewrap" and not seccomp.is_possible():
        return ["keys of the user, perf, watching of files and io_uring are not refused on this kind of processor"]
    return []


def _check_nothing_is_demanded(agent: AgentSpec) -> None:
    where = "started elsewhere" if agent.start.attach else "an object in this process"
    remedy = (
        "Confine it where it is started, and leave this out."
        if agent.start.attach
        else "Leave out --in-process, or start it with door: stdio."
    )
    wanted = {
        "sandbox": {"required": "a sandbox", "auto": "", "none": ""}.get(agent.sandbox, agent.sandbox),
        "limits": "bounds" if agent.limits.are_given else "",
        "environment": "variables" if agent.environment else "",
    }
    for key, value in wanted.items():
        if value:
            raise UsageError(
                f"agents.{agent.name}.{key}: expected an agent with a process that is started here for {value}, was "
                f"{where}. {remedy}"
            )
