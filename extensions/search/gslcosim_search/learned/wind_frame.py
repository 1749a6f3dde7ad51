"""Egocentric wind frame: what a searcher sees with the wind in its face, and when it smelled gas last.

A wind frame is about the vehicle, with one axis upwind and one to the left of it. Policies that see and command in it
need not learn each direction of the wind for itself.
"""

from collections.abc import MutableSequence, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.scalar_kernels import norm2, scalar_kernel
from gslcosim_search import elementary

# What `WindFrame` adds to an observation, in this order.
WIND_FRAME_NAMES = (
    "wind_frame.upwind_sin",
    "wind_frame.upwind_cos",
    "wind_frame.speed",
    "wind_frame.v_upwind",
    "wind_frame.v_left",
    "bouts.since",
    "bouts.amplitude",
    "bouts.count",
    "bouts.upwind",
    "bouts.left",
)
N_WIND_FRAME = len(WIND_FRAME_NAMES)

# Scales: tanh 1, and where 1 / (1 + x) is a half.
_SPEED_M_S = 2.0
_SINCE_S = 10.0
_COUNT = 3.0
_AWAY_M = 2.0
# The wind is averaged over this time, so that its gusts do not turn the frame.
_TURNS_IN_S = 5.0
# A bout begins above one amount and ends below another, so that noise makes no bouts: 0.2 and 0.1 ppm.
_BEGINS, _ENDS = 0.095, 0.06
_ALMOST_ONE = 0.9999
_CALM_M_S = 1e-6

# The numbers of its state.
_HAS_WIND, _WIND_X, _WIND_Y, _UPWIND_X, _UPWIND_Y, _TIME_S = range(6)
_IN_BOUT, _PEAK, _N_BOUTS, _GAS_S, _GAS_X_M, _GAS_Y_M = range(6, 12)
N_STATE = 12
# Where it finds what it looks at, among the numbers of an observation.
_X, _Y, _VX, _VY, _TIME, _GAS, _WIND_0, _WIND_1, _WIND_2 = range(9)
_ABSENT = -1
# Where that direction stands in a state.
UPWIND = slice(_UPWIND_X, _UPWIND_Y + 1)


@scalar_kernel
def _unscaled_speed(number: float) -> float:
    # The inverse of `encoding.scaled_speed`, for speeds up to 9.9 m/s.
    kept = min(max(number, -_ALMOST_ONE), _ALMOST_ONE)
    return _SPEED_M_S * 0.5 * (elementary.log1p(kept) - elementary.log1p(-kept))


@scalar_kernel
def _show_away(length_m: float) -> float:
    return length_m / (_AWAY_M + abs(length_m))


@scalar_kernel
def begin_wind_frame(state: MutableSequence[float]) -> None:
    """Forget all: the state of a search that begins. Without wind so far, upwind is along world x."""
    for i in range(len(state)):
        state[i] = 0.0
    state[_UPWIND_X] = 1.0


@scalar_kernel
def advance_wind_frame(
    state: MutableSequence[float],
    numbers: Any,
    columns: Sequence[int],
    first: int,
    half_x_m: float,
    half_y_m: float,
    time_limit_s: float,
) -> None:
    """Take an observation in, and write the numbers of `WIND_FRAME_NAMES` behind its own.

    w <- w + dt / (5 s + dt) (a + v - w)        a apparent wind, v velocity of the vehicle [m/s]

    Args:
        state: (12,) of the search; advanced.
        numbers: Of the observation; written from `first` on.
        columns: (9,) where its place, velocity, time, gas and wind stand; see `find_columns`.
        first: Where the numbers of the frame begin.
        half_x_m: Half the length of the room along x [m].
        half_y_m: The same along y.

    Held by:
        extensions/search/tests/unit/learned/test_wind_frame.py
    """
    x_m, y_m = half_x_m * float(numbers[columns[_X]]), half_y_m * float(numbers[columns[_Y]])
    vx_m_s = _unscaled_speed(float(numbers[columns[_VX]]))
    vy_m_s = _unscaled_speed(float(numbers[columns[_VY]]))
    time_s = time_limit_s * float(numbers[columns[_TIME]])
    a, b = float(numbers[columns[_WIND_0]]), float(numbers[columns[_WIND_1]])
    if columns[_WIND_2] == _ABSENT:
        wind_x_m_s, wind_y_m_s = _unscaled_speed(a), _unscaled_speed(b)
        is_measured = a != 0.0 or b != 0.0
    else:
        c, speed_m_s = float(numbers[columns[_WIND_2]]), _unscaled_speed(a)
        wind_x_m_s, wind_y_m_s = -speed_m_s * c, -speed_m_s * b
        is_measured = b != 0.0 or c != 0.0
    if is_measured:
        share = 1.0
        if state[_HAS_WIND] != 0.0:
            passed_s = max(time_s - state[_TIME_S], 0.0)
            share = passed_s / (_TURNS_IN_S + passed_s)
        state[_WIND_X] += share * (wind_x_m_s + vx_m_s - state[_WIND_X])
        state[_WIND_Y] += share * (wind_y_m_s + vy_m_s - state[_WIND_Y])
        state[_HAS_WIND] = 1.0
        state[_TIME_S] = time_s
    wind_m_s = norm2(state[_WIND_X], state[_WIND_Y])
    if wind_m_s > _CALM_M_S:
        state[_UPWIND_X], state[_UPWIND_Y] = -state[_WIND_X] / wind_m_s, -state[_WIND_Y] / wind_m_s
    up_x, up_y = state[_UPWIND_X], state[_UPWIND_Y]
    gas = float(numbers[columns[_GAS]])
    if state[_IN_BOUT] != 0.0:
        state[_PEAK] = max(state[_PEAK], gas)
        state[_IN_BOUT] = 0.0 if gas < _ENDS else 1.0
    elif gas > _BEGINS:
        state[_IN_BOUT], state[_PEAK] = 1.0, gas
        state[_N_BOUTS] += 1.0
    if state[_IN_BOUT] != 0.0:
        state[_GAS_S], state[_GAS_X_M], state[_GAS_Y_M] = time_s, x_m, y_m
    numbers[first] = up_y
    numbers[first + 1] = up_x
    numbers[first + 2] = elementary.tanh(wind_m_s / _SPEED_M_S)
    numbers[first + 3] = elementary.tanh((vx_m_s * up_x + vy_m_s * up_y) / _SPEED_M_S)
    numbers[first + 4] = elementary.tanh((vy_m_s * up_x - vx_m_s * up_y) / _SPEED_M_S)
    for i in range(5, 10):
        numbers[first + i] = 0.0
    if state[_N_BOUTS] > 0.0:
        dx_m, dy_m = state[_GAS_X_M] - x_m, state[_GAS_Y_M] - y_m
        numbers[first + 5] = _SINCE_S / (_SINCE_S + max(time_s - state[_GAS_S], 0.0))
        numbers[first + 6] = min(state[_PEAK], 1.0)
        numbers[first + 7] = state[_N_BOUTS] / (_COUNT + state[_N_BOUTS])
        numbers[first + 8] = _show_away(dx_m * up_x + dy_m * up_y)
        numbers[first + 9] = _show_away(dy_m * up_x - dx_m * up_y)


def upwind_of(state: Sequence[float]) -> tuple[float, float]:
    """Return the direction that the wind comes from: a unit vector, world frame."""
    return float(state[_UPWIND_X]), float(state[_UPWIND_Y])


def find_columns(names: Sequence[str]) -> tuple[int, ...]:
    """Return where the wind frame finds what it looks at: nine indices, the last -1 with a wind in components.

    The gas is the first mixing ratio, or else the first detector; the wind is that of the first anemometer.

    Args:
        names: `ObservationVector.names` of an agent.

    Raises:
        UsageError: the agent has no such sensors.
    """
    gas = next((i for ending in (".amount", ".gas") for i, name in enumerate(names) if name.endswith(ending)), None)
    vane = next((name.removesuffix(".from_sin") for name in names if name.endswith(".from_sin")), None)
    if vane is not None:
        wind = tuple(names.index(f"{vane}.{part}") for part in ("speed", "from_sin", "from_cos"))
    else:
        vane = next((name.removesuffix(".x") for name in names if name.endswith(".x")), None)
        wind = (names.index(f"{vane}.x"), names.index(f"{vane}.y"), _ABSENT) if vane is not None else None
    if gas is None or wind is None:
        what = "a sensor of a mixing ratio" if gas is None else "an anemometer"
        raise UsageError(f"wind_frame: expected {what} among the sensors, found none. Add one, or leave the frame out.")
    return (*(names.index(name) for name in ("x", "y", "vx", "vy", "time")), gas, *wind)


class WindFrame:
    """The wind frame of one search, from observation to observation.

    Args:
        names: Of the numbers that it finds in an observation.
        half_x_m: Half the length of the room along x [m].
        half_y_m: The same along y.
        time_limit_s: Time limit of the search [s].

    Raises:
        UsageError: gas or wind is not among them.
    """

    def __init__(self, names: Sequence[str], *, half_x_m: float, half_y_m: float, time_limit_s: float) -> None:
        self._columns, self._n_before = find_columns(names), len(names)
        self._scales = (half_x_m, half_y_m, time_limit_s)
        self._state = [0.0] * N_STATE
        begin_wind_frame(self._state)

    @property
    def upwind(self) -> tuple[float, float]:
        """The direction that the wind comes from: a unit vector, world frame."""
        return upwind_of(self._state)

    def advance(self, numbers: NDArray[np.float32]) -> None:
        """Take an observation in, and write the frame's numbers behind its own."""
        advance_wind_frame(self._state, numbers, self._columns, self._n_before, *self._scales)


def asks_wind_frame(names: Sequence[str]) -> bool:
    """Return whether some observations are those of the wind frame."""
    return any(name in WIND_FRAME_NAMES for name in names)
