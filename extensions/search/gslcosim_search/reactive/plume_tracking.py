"""Agents that follow a plume up the wind, look for it where it was lost, and explore without one."""

from abc import abstractmethod
from collections.abc import Callable

from gslcosim.agent_kit import Briefing, Command, Observation
from gslcosim_search.reactive.reactive_searcher import ReactiveAgent
from gslcosim_search.senses.stop_and_measure import Contact

# A shorter leg is none: what is left of the way without gas counts as flown.
LEAST_LEG_M = 0.1

# The places of a cast, a spiral or a loop, one after the other; nothing when it is over.
Recovery = Callable[[], tuple[float, ...] | None]


class PlumeTrackingAgent(ReactiveAgent):
    """Tracks the plume while there is gas, recovers it when it is lost, and else explores.

    A method says how it tracks and how it recovers.

    Its settings: those of `ReactiveSettings`, lost_m (way without gas after which the plume is lost) and, where it goes
    back to the last gas to recover again, n_returns.

    State: whether it tracks, the wind against which it does so, the recovery under way, and how often it may still go
    back to where gas was met last.
    """

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.upwind_rad = 0.0
        self.is_tracking = False
        self.recovery: Recovery | None = None
        self.n_returns_left = 0

    def next_step(self, observation: Observation, contact: Contact) -> Command:
        """Return the next leg, to track, recover or explore; or the declaration."""
        if contact.upwind_rad is None or self.is_away:
            self.is_tracking, self.recovery = False, None
            return self.explore(observation)
        is_regained = contact.has_gas and not self.is_tracking
        if contact.has_gas:
            self.meet_gas()
            self.is_tracking, self.recovery, self.upwind_rad = True, None, contact.upwind_rad
        if self.is_tracking and not self.is_lost(observation, contact):
            return self.track(observation, contact, is_regained=is_regained)
        if self.is_tracking:
            self.is_tracking, self.n_returns_left = False, getattr(self.settings, "n_returns", 0)
            self.recovery = self.start_recovery(observation.position_world_m, contact)
            answer = self.lose(observation, contact, self.upwind_rad)
            if answer is not None:
                return answer
        return self.recover(observation, contact)

    @property
    def may_abort(self) -> bool:
        """True if gas ends a leg that is under way."""
        return not self.is_tracking

    def meet_gas(self) -> None:
        """Take note that there is gas, before it is tracked."""

    def is_lost(self, observation: Observation, contact: Contact) -> bool:
        """Return True if the plume counts as lost: no gas for a distance."""
        return contact.remaining_m(observation.position_world_m, self.settings.lost_m) <= LEAST_LEG_M

    @abstractmethod
    def track(self, observation: Observation, contact: Contact, *, is_regained: bool) -> Command:
        """Return a leg along the plume.

        Args:
            is_regained: Whether there is gas now and the plume was not tracked before.
        """

    @abstractmethod
    def start_recovery(self, here_m: tuple[float, ...], contact: Contact) -> Recovery:
        """Return the generator of recovery positions from a position, world frame [m]."""

    def recover(self, observation: Observation, contact: Contact) -> Command:
        """Return the next leg of the recovery; after it go back to the last gas and recover there; then explore."""
        while self.recovery is not None:
            command = self.follow(observation, self.recovery)
            if command is not None:
                return command
            last_m = contact.last_m if self.n_returns_left > 0 else None
            self.recovery = None if last_m is None else self.start_recovery(last_m, contact)
            self.n_returns_left -= 1
        return self.explore(observation)
