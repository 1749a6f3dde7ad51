"""The supervisor's side of one agent: its door, its commands, and when it owes an answer."""

from dataclasses import dataclass, field

from gslcosim.runtime.agents.door import Door
from gslcosim.runtime.agents.inlet import CommandQueue
from gslcosim.runtime.digest import Trail
from gslcosim.runtime.host import Kept
from gslcosim.runtime.in_order import InOrder
from gslcosim.scenario.models.scenario import AgentSpec


@dataclass
class Seat:
    """One agent as the supervisor sees it. Times are those of the monotonic clock [s]."""

    spec: AgentSpec
    door: Door
    inlet: CommandQueue
    trail: Trail = field(default_factory=Trail)
    kept: Kept = field(default_factory=Kept)
    in_order: InOrder = field(default_factory=InOrder)
    briefing: bytes | None = None
    observation: bytes = b""
    asked_at: float | None = None
    repeated_at: float = 0.0
    told_tick: int = -1
    is_ready: bool = False
