"""Formations of a team: positions of the robots, keeping the shape, and a plane fitted to their readings.

Slots are given in the frame of the formation: x upwind, y to the left of upwind, the mean of all slots at the origin.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Below this ratio of their two spreads, places count as lying on one line.
COLLINEAR_FRAC = 0.05


def diagonal_line(n: int, spacing_m: float) -> Floats:
    """Return (n, 2) slots on a diagonal line: each robot a spacing to the left of the last, and a spacing upwind.

    s_i = (i - (n - 1) / 2) d (1, 1)        d spacing across the wind and along it [m]

    Source:
        Marjovi and Marques 2013 (abstract: equally spaced robots on a diagonal line are the best for finding plumes).
    Deviation:
        The slope of 45 degrees is ours; the paper's follows from wind and dispersion.
    Held by:
        tests/unit/search/swarms/test_formations.py
    """
    steps = np.arange(n, dtype=np.float64) - (n - 1) / 2.0
    return spacing_m * np.column_stack((steps, steps))


def inverted_v(n: int, spacing_m: float) -> Floats:
    """Return (n, 2) slots of an inverted V: the first robot upwind of all, the others trailing on two arms.

    s_0 = 0, s_i = -ceil(i / 2) d (1, +-1), then shifted so that the mean is 0        d spacing [m]

    Source:
        Soares, Aguiar, Pascoal, Martinoli 2015, ICRA, doi:10.1109/ICRA.2015.7139402 (shape named; measures ours).
    Held by:
        tests/unit/search/swarms/test_formations.py
    """
    ranks = np.array([(i + 1) // 2 for i in range(n)], dtype=np.float64)
    sides = np.array([1.0 if i % 2 else -1.0 for i in range(n)])
    return _centred(-spacing_m * np.column_stack((ranks, -ranks * sides)))


def ring(n: int, radius_m: float, *, with_centre: bool = False, first_rad: float = 0.0) -> Floats:
    """Return (n, 2) slots equally spaced on a circle, counter-clockwise; with a centre the first slot is that.

    Args:
        n: Robots, the one in the centre among them.
        radius_m: Radius of the circle [m].
        with_centre: Whether one robot stands in the middle.
        first_rad: Direction of the first place on the circle, counter-clockwise from upwind [rad].
    """
    n_around = n - 1 if with_centre else n
    angles_rad = first_rad + np.arange(n_around) * (2.0 * math.pi / max(n_around, 1))
    around = radius_m * np.column_stack((np.cos(angles_rad), np.sin(angles_rad)))
    return np.vstack((np.zeros((1, 2)), around)) if with_centre else around


def square_with_centre(radius_m: float) -> Floats:
    """Return the (5, 2) slots of a square with its centre, sides along and across the wind, corners `radius_m` away.

    Source:
        Soares, Aguiar, Pascoal, Martinoli 2015 (shape named; measures ours).
    """
    return ring(5, radius_m, with_centre=True, first_rad=math.pi / 4.0)


def hexagon(radius_m: float, *, with_centre: bool = True) -> Floats:
    """Return the (7, 2) or (6, 2) slots of a hexagon: all neighbours are `radius_m` apart.

    Source:
        Zarzhitsky, Spears, Thayer 2005 (remembered, unverified).
    """
    return ring(7 if with_centre else 6, radius_m, with_centre=with_centre)


SHAPES = ("ring", "square", "hexagon", "inverted_v", "line")


def formation(shape: str, n: int, size_m: float) -> Floats:
    """Return (n, 2) slots of a named shape for any number of robots.

    Args:
        shape: `line` and `inverted_v` have a spacing of `size_m`; `ring`, `square` and `hexagon` a radius of
            `size_m`. A square or a hexagon is what it is called for 5 (or 4) and for 7 (or 6) robots; with other
            numbers it is a ring, from five robots on with one of them in the centre.
        n: Robots.
        size_m: Spacing or radius [m].

    Raises:
        ValueError: no such shape.
    """
    makers: dict[str, Callable[[], Floats]] = {
        "line": lambda: diagonal_line(n, size_m),
        "inverted_v": lambda: inverted_v(n, size_m),
        "ring": lambda: ring(n, size_m),
        "square": lambda: ring(n, size_m, with_centre=n >= 5, first_rad=math.pi / 4.0 if n in (4, 5) else 0.0),
        "hexagon": lambda: ring(n, size_m, with_centre=n == 5 or n >= 7),
    }
    if shape not in makers:
        raise ValueError(f"shape: expected one of {', '.join(SHAPES)}, was {shape}.")
    return _centred(makers[shape]())


def in_world(slots_m: Floats, upwind_rad: float) -> Floats:
    """Return (n, 2) slots turned from the frame of the formation into the world's axes.

    b = (s_x cos a - s_y sin a, s_x sin a + s_y cos a)        a direction the wind comes from, from world x [rad]
    """
    cos, sin = math.cos(upwind_rad), math.sin(upwind_rad)
    x, y = slots_m[:, 0], slots_m[:, 1]
    return np.column_stack((x * cos - y * sin, x * sin + y * cos))


def centre_m(positions_m: Floats, offsets_m: Floats) -> Floats:
    """Return the place (2,) from which the robots' offsets lead to where they are, in the mean of the robots.

    m = mean_i(p_i - b_i)        [m] = [m]

    It is the centre of the whole formation even when some of its robots are not among those that are given.

    Args:
        positions_m: (n, 2) places, world frame [m].
        offsets_m: (n, 2) slots of the same robots, turned into world axes [m].
    """
    return np.mean(positions_m - offsets_m, axis=0)


@dataclass(frozen=True, kw_only=True)
class PlaneFit:
    """A plane through readings: c(x) = mean + gradient . (x - mean place).

    `gradient_per_m` is absent where the places do not span a plane: `problem` then says why, in a sentence.
    `residual` is the root of the mean squared misfit, in the unit of the readings.
    """

    mean: float
    gradient_per_m: tuple[float, float] | None
    residual: float = 0.0
    problem: str = ""


def fit_plane(positions_m: Floats, readings: Floats) -> PlaneFit:
    """Fit a plane through readings by least squares.

    g = (D^T D)^-1 D^T (c - mean c), rows D_i = p_i - mean p
    [c / m] = [1 / m^2] [m] [c]

    Args:
        positions_m: (n, 2) places of the readings, world frame [m].
        readings: (n,) gas at these places, any unit.

    Returns:
        The plane; without a gradient for fewer than three robots, and for robots in a line: there the slope across
        the line is unknown, and the pseudo-inverse's zero would pass for a measurement.

    Source:
        Least squares; as a formation's gradient, Marjovi and Marques 2014 and others.
    Held by:
        tests/unit/search/swarms/test_formations.py (an exact plane comes back; three in a line are refused)
    """
    readings = np.asarray(readings, dtype=np.float64)
    n = len(readings)
    if n == 0:
        return PlaneFit(mean=0.0, gradient_per_m=None, problem="expected readings of three robots, there were none.")
    mean = float(readings.mean())
    if n < 3:
        return PlaneFit(mean=mean, gradient_per_m=None, problem=f"expected readings of three robots, there were {n}.")
    rows = np.asarray(positions_m, dtype=np.float64) - np.mean(positions_m, axis=0)
    long_m, short_m = np.linalg.svd(rows, compute_uv=False)
    if short_m <= COLLINEAR_FRAC * long_m or long_m == 0.0:
        problem = f"expected robots that span a plane, the {n} were in a line: the slope across it is unknown."
        return PlaneFit(mean=mean, gradient_per_m=None, problem=problem)
    gradient = np.linalg.lstsq(rows, readings - mean, rcond=None)[0]
    misfit = readings - mean - rows @ gradient
    residual = math.sqrt(float(np.mean(misfit**2)))
    return PlaneFit(mean=mean, gradient_per_m=(float(gradient[0]), float(gradient[1])), residual=residual)


def mixed_direction(gradient: tuple[float, float] | None, upwind_rad: float | None, wind_share: float) -> Floats | None:
    """Return the unit direction (2,) between up the gradient and up the wind; with one of them missing, the other.

    d = (1 - k) g / |g| + k u, made a unit vector        k wind_share, u unit vector upwind

    Returns:
        The direction, or None where neither is known or where the two cancel.

    Source:
        The mix is ours; formations that climb gradients ignore the wind.
    """
    parts = np.zeros(2)
    length = 0.0 if gradient is None else math.hypot(*gradient)
    if gradient is not None and length > 0.0:
        parts += (1.0 - wind_share if upwind_rad is not None else 1.0) * np.array(gradient) / length
    if upwind_rad is not None:
        parts += (wind_share if length > 0.0 else 1.0) * np.array((math.cos(upwind_rad), math.sin(upwind_rad)))
    size = math.hypot(parts[0], parts[1])
    return parts / size if size > 1e-9 else None


def odour_offset_m(positions_m: Floats, amounts: Floats, upwind_rad: float) -> float:
    """Return how far the centre of the odour lies to the left of the robots' centre, across the wind.

    e = sum_i(c_i y_i) / sum_i(c_i) - mean_i(y_i)        y to the left of upwind [m], 0 where there is no gas
    [m] = [c] [m] / [c]

    Args:
        positions_m: (n, 2) places, world frame [m].
        amounts: (n,) gas, not negative, any unit.
        upwind_rad: Direction the wind comes from, world frame [rad].

    Source:
        Soares, Aguiar, Pascoal, Martinoli 2015 (abstract; formula after the specification, unverified).
    Held by:
        tests/unit/search/swarms/test_formations.py (a plume on the left pulls to the left)
    """
    total = float(np.sum(amounts))
    if total <= 0.0:
        return 0.0
    left_m = -math.sin(upwind_rad) * positions_m[:, 0] + math.cos(upwind_rad) * positions_m[:, 1]
    return float(np.sum(amounts * left_m) / total - left_m.mean())


def laplacian_velocity_m_s(
    i: int,
    positions_m: Floats,
    offsets_m: Floats,
    upwind_rad: float,
    odour_m: float,
    *,
    formation_per_s: float,
    upwind_m_s: float,
    odour_per_s: float,
) -> Floats:
    """Return the velocity (2,) of one robot of a formation that goes upwind and centres itself on the odour.

    v_i = k_f sum_j [(p_j - p_i) - (b_j - b_i)] + k_u u + k_c e w
    [m/s] = [1/s] [m] + [m/s] + [1/s] [m]

    The sum over the robots is zero, so the formation's centre moves with k_u u + k_c e w whatever its shape, and where
    all stand in their places every robot moves with it.

    Args:
        i: Which robot.
        positions_m: (n, 2) places of it and the robots that it hears, p, world frame [m].
        offsets_m: (n, 2) slots of the same robots in world axes, b [m].
        upwind_rad: Direction the wind comes from; u is its unit vector, w the one to the left of it [rad].
        odour_m: Offset e of the odour to the left, see `odour_offset_m` [m].
        formation_per_s: Gain k_f. Commands `dt` apart converge for k_f n dt < 2; the caller sees to it.
        upwind_m_s: Speed k_u up the wind.
        odour_per_s: Gain k_c.

    Source:
        Soares, Aguiar, Pascoal, Martinoli 2015, ICRA (abstract; gains and odour term unverified).
    Held by:
        tests/unit/search/swarms/test_formations.py (equilibrium, speed of the centre)
    """
    errors_m = (positions_m - positions_m[i]) - (offsets_m - offsets_m[i])
    upwind = np.array((math.cos(upwind_rad), math.sin(upwind_rad)))
    left = np.array((-upwind[1], upwind[0]))
    return formation_per_s * errors_m.sum(axis=0) + upwind_m_s * upwind + odour_per_s * odour_m * left


def laplacian_leg_m(
    i: int,
    positions_m: Floats,
    offsets_m: Floats,
    upwind_rad: float,
    odour_m: float,
    *,
    dt_s: float,
    formation_per_s: float,
    upwind_m_s: float,
    odour_per_s: float,
) -> Floats:
    """Return how far one robot goes (2,) when all follow `laplacian_velocity_m_s` for a while, with one reading.

    d_i = (1 - exp(-k_f n dt)) / n sum_j [(p_j - p_i) - (b_j - b_i)] + dt (k_u u + k_c e w)
    [m] = [m] + [s] [m/s]

    The arguments are those of `laplacian_velocity_m_s`, and how long dt the law is followed [s].

    Source:
        Our integral of that law: with all robots in touch, each error decays with the rate k_f n. A leg of dt v_i would
        overshoot from k_f n dt = 1 on, and swing ever farther from 2 on.
    Held by:
        tests/unit/search/swarms/test_formations.py (as the law for small dt, in place for large)
    """
    errors_m = (positions_m - positions_m[i]) - (offsets_m - offsets_m[i])
    n = len(positions_m)
    drift_m_s = laplacian_velocity_m_s(
        i, positions_m, offsets_m, upwind_rad, odour_m,
        formation_per_s=0.0, upwind_m_s=upwind_m_s, odour_per_s=odour_per_s,
    )  # fmt: skip
    return -math.expm1(-formation_per_s * n * dt_s) / n * errors_m.sum(axis=0) + dt_s * drift_m_s


def next_width(
    width: float, slots_m: Floats, smells: NDArray[np.bool_], *, change_frac: float, least: float, most: float
) -> float:
    """Return by how much a formation is to be stretched, by who smells gas: wider when its edges do, else narrower.

    w <- w (1 + q) when a robot on the left or the right edge smells gas, w / (1 + q) when only others do, else w

    Args:
        width: Present factor w on the slots.
        slots_m: (n, 2) slots in the frame of the formation; the edges are the greatest and the least y [m].
        smells: (n,) who smells gas.
        change_frac: Step q of one change.
        least: Least factor.
        most: Greatest factor.

    Source:
        Soares, Aguiar, Pascoal, Martinoli 2015 (abstract; step and limits ours).
    Held by:
        tests/unit/search/swarms/test_formations.py
    """
    if not smells.any():
        return width
    left_m = slots_m[:, 1]
    is_edge = np.isclose(np.abs(left_m - left_m.mean()), np.abs(left_m - left_m.mean()).max(), atol=1e-9)
    changed = width * (1.0 + change_frac) if (smells & is_edge).any() else width / (1.0 + change_frac)
    return min(most, max(least, changed))


def _centred(slots_m: Floats) -> Floats:
    return slots_m - slots_m.mean(axis=0)
