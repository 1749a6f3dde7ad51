"""Simulated time that follows the clock on the wall: when a tick may begin, and how late ticks were."""

from typing import Any

from gslcosim.runtime.setup import Setup
from gslcosim.ticks import NS_PER_S

# Whom all others wait for: where it is held back, nobody else gets far.
PACED = "world"
# What is lost by more than that is not made up for: nobody who looks on could follow.
LOST_AFTER_S = 1.0


class ClockPace:
    """Holds ticks back until their time has come. It has no influence on what is in them.

    Tick k may begin k ticks after the first one, by the clock on the wall divided by the pace. A tick that begins later
    than that by more than its own length counts as late. Small delays are made up for; one of more than `LOST_AFTER_S`
    is lost: from there time goes on at the pace.

    All times are those of the monotonic clock [s].

    Args:
        pace: Simulated seconds in a second.
        tick_ns: How long a tick is.
        from_tick: The first tick that is held back.
    """

    def __init__(self, pace: float, tick_ns: int, *, from_tick: int = 0) -> None:
        self._pace = pace
        self._tick_s = tick_ns / NS_PER_S / pace
        self._from_tick = from_tick
        self._origin_s: float | None = None
        self._worst_lag_s = 0.0
        self._lost_s = 0.0
        self._n_late = 0
        self._n_ticks = 0

    def wait_s(self, tick: int, now_s: float) -> float:
        """Return how long it takes until a tick may begin; 0 where it may."""
        if tick < self._from_tick:
            return 0.0
        return max(0.0, self._due_s(tick, now_s) - now_s)

    def begins(self, tick: int, now_s: float) -> None:
        """Take note that a tick begins."""
        if tick < self._from_tick:
            return
        lag_s = max(0.0, now_s - self._due_s(tick, now_s))
        self._n_ticks += 1
        self._n_late += lag_s > self._tick_s
        self._worst_lag_s = max(self._worst_lag_s, lag_s)
        if lag_s > LOST_AFTER_S and self._origin_s is not None:
            self._origin_s += lag_s
            self._lost_s += lag_s

    def account(self) -> dict[str, Any]:
        """Return what `result.json` says of it."""
        return {
            "pace": {
                "factor": self._pace,
                "worst_lag_s": round(self._worst_lag_s, 3),
                "late_share": round(self._n_late / max(self._n_ticks, 1), 4),
                "lost_s": round(self._lost_s, 3),
            }
        }

    def _due_s(self, tick: int, now_s: float) -> float:
        if self._origin_s is None:
            self._origin_s = now_s - (tick - self._from_tick) * self._tick_s
        return self._origin_s + (tick - self._from_tick) * self._tick_s


def clock_pace_of(setup: Setup) -> ClockPace | None:
    """Return what holds the ticks of a run back; nothing where its time follows no clock."""
    pace = setup.scenario.pace
    if pace is None or setup.paced_from_tick is None:
        return None
    return ClockPace(pace, setup.scenario.tick_ns, from_tick=setup.paced_from_tick)
