"""Sidestep around obstacles for a vehicle that moves by velocity and knows no map: turn until the way is free."""

import math


class Sidestep:
    """Turns a heading by eighths of a circle, to one side, as long as its velocity is refused; then keeps the turn.

    turn = side n pi/4        n refusals since it last went straight on, side +1 to the left

    A turn is kept for some seconds after the last refusal: along a wall this is a path beside it, with a look back
    every so often whether the old heading is free again.

    State: the number of refusals, and until when the turn is kept.

    Held by:
        tests/unit/search/reactive/test_sidestep.py
    """

    def __init__(self, *, side: int, keep_s: float) -> None:
        """Begin straight on.

        Args:
            side: +1 turns to the left, -1 to the right.
            keep_s: How long a turn is kept after the last refusal [s].
        """
        self._side = side
        self._keep_s = keep_s
        self._n = 0
        self._until_s = -math.inf

    @property
    def turn_rad(self) -> float:
        """By how much the heading is turned now [rad]."""
        return self._side * self._n * 0.25 * math.pi

    def note(self, time_s: float, *, is_refused: bool) -> None:
        """Take note of whether the last velocity was refused.

        Args:
            time_s: Now [s].
            is_refused: Whether the vehicle did not do as it was asked.
        """
        if is_refused:
            self._n = (self._n + 1) % 8
            self._until_s = time_s + self._keep_s
        elif time_s > self._until_s:
            self._n = 0
