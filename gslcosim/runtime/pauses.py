"""Noticing that this process itself stood still: it was stopped, or the machine gave it no time."""

PAUSE_S = 1.0


class Pauses:
    """Tells from looks that come many times a second which time nobody has lived through.

    What has been waited for meanwhile is not late: whoever keeps deadlines moves them by that time. It reads no clock:
    times [s] of a monotonic one are handed in. That clock does not run while a machine is suspended.
    """

    def __init__(self) -> None:
        self._looked_at_s: float | None = None

    def missed_s(self, now_s: float) -> float:
        """Return the time [s] since the last look where it is far longer than usual, else 0."""
        since_s = now_s - self._looked_at_s if self._looked_at_s is not None else 0.0
        self._looked_at_s = now_s
        return since_s if since_s > PAUSE_S else 0.0
