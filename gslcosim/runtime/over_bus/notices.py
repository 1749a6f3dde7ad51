"""What the supervisor hears of a run, besides what agents do: frozen, and handled one by one on its own thread."""

from dataclasses import dataclass

from gslcosim.runtime.agents.events import AgentEvent


@dataclass(frozen=True)
class BundleCame:
    """A service has sent the messages of several ports and ticks in one."""

    payload: bytes


@dataclass(frozen=True)
class BriefingCame:
    """The briefing of an agent, on its way there."""

    agent: str
    payload: bytes


@dataclass(frozen=True)
class ObservationCame:
    """An observation of an agent that was asked for again."""

    agent: str
    payload: bytes


@dataclass(frozen=True)
class VerdictCame:
    """The verdict, which was asked for again."""

    payload: bytes


@dataclass(frozen=True)
class ProgressTold:
    """A participant tells which tick it has finished."""

    name: str
    payload: bytes


@dataclass(frozen=True)
class WaitingTold:
    """A participant tells what it waits for."""

    name: str
    payload: bytes


@dataclass(frozen=True)
class ByeSaid:
    """A service is done."""

    name: str
    payload: bytes


@dataclass(frozen=True)
class FaultTold:
    """A service has failed and says how."""

    name: str
    payload: bytes


@dataclass(frozen=True)
class ServiceAppeared:
    """A service's liveliness token is there."""

    name: str


@dataclass(frozen=True)
class ServiceDescribed:
    """A service says what it is."""

    payload: bytes


@dataclass(frozen=True)
class ServiceVanished:
    """A service's liveliness token is gone."""

    name: str


@dataclass(frozen=True)
class AgentVanished:
    """The liveliness token of an agent on the bus is gone."""

    agent: str


@dataclass(frozen=True)
class ProcessEnded:
    """A process that joins the bus has ended."""

    name: str
    exit_code: int
    how: str


@dataclass(frozen=True)
class ProcessStopped:
    """A process that joins the bus has been stopped for too long, and is being killed."""

    name: str


@dataclass(frozen=True)
class Interrupted:
    """Somebody wants the run to end."""


Notice = (
    BundleCame
    | BriefingCame
    | ObservationCame
    | VerdictCame
    | ProgressTold
    | WaitingTold
    | ByeSaid
    | FaultTold
    | ServiceAppeared
    | ServiceDescribed
    | ServiceVanished
    | AgentVanished
    | ProcessEnded
    | ProcessStopped
    | Interrupted
    | AgentEvent
)
