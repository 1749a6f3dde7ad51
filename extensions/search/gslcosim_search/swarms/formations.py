"""Formations of a team: positions, keeping the shape, search for a plume, and rounds of a flight in formation.

Slots are given in the frame of the formation: x upwind, y to the left of upwind, the mean of all slots at the origin.

Held by:
    extensions/search/tests/unit/swarms/test_formations.py
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from gslcosim.agent_kit import Briefing, Command, Observation, RadioMessage
from gslcosim.base.scalar_kernels import norm2
from gslcosim_search import elementary
from gslcosim_search.motion.declaration import Estimate, SwarmRule
from gslcosim_search.motion.legs import LegPlanner, LegSpace
from gslcosim_search.reactive.cast_and_surge import CastSequence
from gslcosim_search.search_agent import SearchAgent
from gslcosim_search.senses.instruments import find_noses, find_vanes
from gslcosim_search.senses.stop_and_measure import MeasuredWind, TrustedWind
from gslcosim_search.swarms.particle_swarm import Sighting
from gslcosim_search.swarms.rounds import Report, ReportedBest, Round, Rounds
from gslcosim_search.swarms.swarm_robot import GasScale

Floats = NDArray[np.float64]

# Below this ratio of their two spreads, places count as lying on one line.
COLLINEAR_FRAC = 0.05
SHAPES = ("ring", "square", "hexagon", "inverted_v", "line")
# How much of the team's wind is that of the last round; the rest is what it was before.
_NEW_WIND_FRAC = 0.5


def diagonal_line(n: int, spacing_m: float) -> Floats:
    """Return (n, 2) slots on a diagonal line: each robot a spacing to the left of the last, and a spacing upwind.

    s_i = (i - (n - 1) / 2) d (1, 1)        d spacing across the wind and along it [m]

    Source:
        Marjovi and Marques 2013 (abstract: equally spaced robots on a diagonal line are the best for finding plumes).
    Deviation:
        The slope of 45 degrees is ours; the paper's follows from wind and dispersion.
    """
    steps = np.arange(n, dtype=np.float64) - (n - 1) / 2.0
    return spacing_m * np.column_stack((steps, steps))


def inverted_v(n: int, spacing_m: float) -> Floats:
    """Return (n, 2) slots of an inverted V: the first robot upwind of all, the others trailing on two arms.

    s_0 = 0, s_i = -ceil(i / 2) d (1, +-1), then shifted so that the mean is 0        d spacing [m]

    Source:
        Soares, Aguiar, Pascoal, Martinoli 2015, ICRA, doi:10.1109/ICRA.2015.7139402 (shape named; measures ours).
    """
    ranks = np.array([(i + 1) // 2 for i in range(n)], dtype=np.float64)
    sides = np.array([1.0 if i % 2 else -1.0 for i in range(n)])
    return _centred(-spacing_m * np.column_stack((ranks, -ranks * sides)))


def ring(n: int, radius_m: float, *, with_centre: bool = False, first_rad: float = 0.0) -> Floats:
    """Return (n, 2) slots equally spaced on a circle, counter-clockwise; with a centre the first slot is that.

    Args:
        n: Robots, the one in the centre among them.
        with_centre: Whether one robot stands in the middle.
        first_rad: Direction of the first place on the circle, counter-clockwise from upwind [rad].
    """
    n_around = n - 1 if with_centre else n
    angles_rad = first_rad + np.arange(n_around) * (2.0 * math.pi / max(n_around, 1))
    around = radius_m * np.column_stack((elementary.cos_each(angles_rad), elementary.sin_each(angles_rad)))
    return np.vstack((np.zeros((1, 2)), around)) if with_centre else around


def hexagon(radius_m: float, *, with_centre: bool = True) -> Floats:
    """Return the (7, 2) or (6, 2) slots of a hexagon: all neighbours are `radius_m` apart.

    Source:
        Zarzhitsky, Spears, Thayer 2005 (remembered, unverified).
    """
    return ring(7 if with_centre else 6, radius_m, with_centre=with_centre)


def formation(shape: str, n: int, size_m: float) -> Floats:
    """Return (n, 2) slots of a named shape for any number of robots.

    Args:
        shape: `line` and `inverted_v` have a spacing of `size_m`; `ring`, `square` and `hexagon` a radius of
            `size_m`. A square or a hexagon is what it is called for 5 (or 4) and for 7 (or 6) robots; with other
            numbers it is a ring, from five robots on with one of them in the centre.

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
    cos, sin = elementary.cos(upwind_rad), elementary.sin(upwind_rad)
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
        extensions/search/tests/unit/swarms/test_formations.py (an exact plane comes back; three in a line are refused)
    """
    readings = np.asarray(readings, dtype=np.float64)
    n = len(readings)
    if n == 0:
        return PlaneFit(mean=0.0, gradient_per_m=None, problem="expected readings of three robots, there were none.")
    mean = float(readings.mean())
    if n < 3:
        return PlaneFit(mean=mean, gradient_per_m=None, problem=f"expected readings of three robots, there were {n}.")
    rows = np.asarray(positions_m, dtype=np.float64) - np.mean(positions_m, axis=0)
    (xx, xy), (_, yy) = elementary.product(rows.T, rows).tolist()
    # The squares of the spreads along and across have this product, and the sum xx + yy.
    determinant, least = xx * yy - xy * xy, COLLINEAR_FRAC * (xx + yy)
    if not determinant > least * least:
        problem = f"expected robots that span a plane, the {n} were in a line: the slope across it is unknown."
        return PlaneFit(mean=mean, gradient_per_m=None, problem=problem)
    x, y = elementary.product(rows.T, readings - mean).tolist()
    gradient = ((yy * x - xy * y) / determinant, (xx * y - xy * x) / determinant)
    misfit = readings - mean - elementary.product(rows, gradient)
    residual = math.sqrt(float(np.mean(np.square(misfit))))
    return PlaneFit(mean=mean, gradient_per_m=gradient, residual=residual)


def mixed_direction(gradient: tuple[float, float] | None, upwind_rad: float | None, wind_share: float) -> Floats | None:
    """Return the unit direction (2,) between up the gradient and up the wind; with one of them missing, the other.

    d = (1 - k) g / |g| + k u, made a unit vector        k wind_share, u unit vector upwind

    Returns:
        The direction, or None where neither is known or where the two cancel.

    Source:
        The mix is ours; formations that climb gradients ignore the wind.
    """
    parts = np.zeros(2)
    length = 0.0 if gradient is None else norm2(*gradient)
    if gradient is not None and length > 0.0:
        parts += (1.0 - wind_share if upwind_rad is not None else 1.0) * np.array(gradient) / length
    if upwind_rad is not None:
        parts += (wind_share if length > 0.0 else 1.0) * np.array(
            (elementary.cos(upwind_rad), elementary.sin(upwind_rad))
        )
    size = norm2(parts[0], parts[1])
    return parts / size if size > 1e-9 else None


def odour_offset_m(positions_m: Floats, amounts: Floats, upwind_rad: float) -> float:
    """Return the crosswind offset of the odour's centre from the robots' centre, positive to the left.

    e = sum_i(c_i y_i) / sum_i(c_i) - mean_i(y_i)        y to the left of upwind [m], 0 where there is no gas
    [m] = [c] [m] / [c]

    Args:
        positions_m: (n, 2) places, world frame [m].
        amounts: (n,) gas, not negative, any unit.
        upwind_rad: Direction the wind comes from, world frame [rad].

    Source:
        Soares, Aguiar, Pascoal, Martinoli 2015 (abstract; formula after the specification, unverified).
    Held by:
        extensions/search/tests/unit/swarms/test_formations.py (a plume on the left pulls to the left)
    """
    total = float(np.sum(amounts))
    if total <= 0.0:
        return 0.0
    left_m = -elementary.sin(upwind_rad) * positions_m[:, 0] + elementary.cos(upwind_rad) * positions_m[:, 1]
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
        extensions/search/tests/unit/swarms/test_formations.py (equilibrium, speed of the centre)
    """
    errors_m = (positions_m - positions_m[i]) - (offsets_m - offsets_m[i])
    upwind = np.array((elementary.cos(upwind_rad), elementary.sin(upwind_rad)))
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
    """Return the displacement (2,) of one robot while all follow `laplacian_velocity_m_s`, with one reading.

    d_i = (1 - exp(-k_f n dt)) / n sum_j [(p_j - p_i) - (b_j - b_i)] + dt (k_u u + k_c e w)
    [m] = [m] + [s] [m/s]

    The arguments are those of `laplacian_velocity_m_s`, and how long dt the law is followed [s].

    Source:
        Our integral of that law: with all robots in touch, each error decays with the rate k_f n. A leg of dt v_i would
        overshoot from k_f n dt = 1 on, and swing ever farther from 2 on.
    Held by:
        extensions/search/tests/unit/swarms/test_formations.py (as the law for small dt, in place for large)
    """
    errors_m = (positions_m - positions_m[i]) - (offsets_m - offsets_m[i])
    n = len(positions_m)
    drift_m_s = laplacian_velocity_m_s(
        i, positions_m, offsets_m, upwind_rad, odour_m,
        formation_per_s=0.0, upwind_m_s=upwind_m_s, odour_per_s=odour_per_s,
    )  # fmt: skip
    return -elementary.expm1(-formation_per_s * n * dt_s) / n * errors_m.sum(axis=0) + dt_s * drift_m_s


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

    Source:
        Soares, Aguiar, Pascoal, Martinoli 2015 (abstract; step and limits ours).
    """
    if not smells.any():
        return width
    left_m = slots_m[:, 1]
    is_edge = np.isclose(np.abs(left_m - left_m.mean()), np.abs(left_m - left_m.mean()).max(), atol=1e-9)
    changed = width * (1.0 + change_frac) if (smells & is_edge).any() else width / (1.0 + change_frac)
    return min(most, max(least, changed))


def _centred(slots_m: Floats) -> Floats:
    return slots_m - slots_m.mean(axis=0)


def nearest_axis_rad(heading_rad: float) -> float:
    """Return the direction of the room's axis that is nearest to a heading: 0, pi/2, pi or -pi/2 [rad]."""
    return math.remainder(round(heading_rad / (math.pi / 2.0)) * (math.pi / 2.0), 2.0 * math.pi)


def plan_crosswind_lanes(room: LegSpace, upwind_rad: float, lane_m: float, *, inset_m: float = 0.0) -> Floats:
    """Return the (m, 2) turns of lanes back and forth across the wind, one after the other up the wind.

    Lanes lie along the axis of the room that is nearest to across the wind, as few as cover the room when each covers
    `lane_m`: n = ceil(L / lane), L / n apart and L / (2 n) from the walls.

    Args:
        upwind_rad: Direction the wind comes from, world frame [rad].
        lane_m: How wide a lane is at most [m].
        inset_m: How far before the room's sides the lanes turn [m]; at most to the middle.

    Source:
        Marjovi and Marques 2013 (abstract: sweeps across the wind). Lanes along walls are ours: they leave no corner.
    Held by:
        extensions/search/tests/unit/swarms/test_formations.py (no place is farther than half a lane from the lanes)
    """
    along_rad = nearest_axis_rad(upwind_rad)
    along = 0 if abs(elementary.cos(along_rad)) > 0.5 else 1
    across = 1 - along
    low_m, high_m = np.array(room.min_m[:2]), np.array(room.max_m[:2])
    n = max(1, math.ceil((high_m - low_m)[along] / lane_m - 1e-9))
    lanes_m = low_m[along] + (np.arange(n) + 0.5) * (high_m - low_m)[along] / n
    if elementary.cos(along_rad) + elementary.sin(along_rad) < 0.0:
        lanes_m = lanes_m[::-1]
    middle_m = 0.5 * (low_m + high_m)[across]
    ends_m = (min(low_m[across] + inset_m, middle_m), max(high_m[across] - inset_m, middle_m))
    turns_m = np.empty((2 * n, 2))
    turns_m[:, along] = np.repeat(lanes_m, 2)
    turns_m[:, across] = [ends_m[(i + j) % 2] for i in range(n) for j in range(2)]
    return turns_m


def find_lane_point(lanes_m: Floats, distance_m: float) -> Floats:
    """Return the place (2,) after a distance along lanes [m]; after its end it begins again at its beginning."""
    lengths_m = np.linalg.norm(np.diff(lanes_m, axis=0), axis=1)
    total_m = float(lengths_m.sum())
    if total_m == 0.0:
        return lanes_m[0]
    rest_m = distance_m % total_m
    for start_m, end_m, length_m in zip(lanes_m, lanes_m[1:], lengths_m):
        if rest_m <= length_m and length_m > 0.0:
            return start_m + rest_m / length_m * (end_m - start_m)
        rest_m -= length_m
    return lanes_m[-1]


def find_next_lane_point(lanes_m: Floats, place_m: Sequence[float] | Floats, step_m: float) -> Floats:
    """Return the next point on lanes: one step after the point nearest to a position, from their end to their start.

    It needs no memory, so all of a team that know where they are go the same way.

    Args:
        lanes_m: (m, 2) turns [m].
        step_m: How far along the lanes [m].
    """
    place = np.asarray(place_m[:2], dtype=np.float64)
    starts_m, spans_m = lanes_m[:-1], np.diff(lanes_m, axis=0)
    lengths_m = np.linalg.norm(spans_m, axis=1)
    fractions = np.sum((place - starts_m) * spans_m, axis=1) / np.square(np.maximum(lengths_m, 1e-9))
    fractions = np.clip(fractions, 0.0, 1.0)
    away_m = np.linalg.norm(starts_m + fractions[:, None] * spans_m - place, axis=1)
    # The last of equally near pieces, so that a turn leads on and not back.
    i = len(away_m) - 1 - int(np.argmin(np.round(away_m[::-1], 6)))
    along_m = float(lengths_m[:i].sum() + fractions[i] * lengths_m[i])
    total_m = float(lengths_m.sum())
    if total_m - along_m < 0.05:
        return lanes_m[0]
    return lanes_m[-1] if along_m + step_m >= total_m else find_lane_point(lanes_m, along_m + step_m)


class PlumeMemory:
    """Goals of a team while it has no gas: casts about the last place with gas, then the lanes.

    State: the last place with gas and the wind there, and how far the cast about it has come.

    Source:
        Casting as in Lochmatter and Martinoli 2008; of a whole formation, ours.
    """

    def __init__(self, lanes_m: Floats, *, step_m: float, cast_m: float, n_casts: int) -> None:
        """Prepare for a search without gas.

        Args:
            lanes_m: (m, 2) turns of the lanes [m].
            n_casts: Legs of a cast before the lanes are taken up again; 0 for none.
        """
        self._lanes_m, self._step_m, self._cast_m, self._n_casts = lanes_m, step_m, cast_m, n_casts
        self._cast: CastSequence | None = None

    def met_gas(self, place_m: Sequence[float] | Floats, upwind_rad: float) -> None:
        """Take note that there is gas at the team's place."""
        anchor_m = (float(place_m[0]), float(place_m[1]))
        self._cast = CastSequence(
            anchor_m=anchor_m, upwind_rad=upwind_rad, side=1, width_m=self._cast_m, n_legs=self._n_casts
        )

    def next_place_m(self, place_m: Sequence[float] | Floats) -> Floats:
        """Return the next position of the team without gas (2,) [m]."""
        turn_m = None if self._cast is None else self._cast.next_turn_m()
        if turn_m is not None:
            return np.array(turn_m)
        self._cast = None
        return find_next_lane_point(self._lanes_m, place_m, self._step_m)


class FormationAgent(SearchAgent):
    """One robot of a formation that reads in rounds: all wait until all have read, and then step together.

    A method says where its robot goes next. Its settings: `wall_margin_m`, `hold_s` (how long each place is read),
    `gas_floor`, `mox_band_frac`, `calm_m_s` (a wind no faster has no direction), `timeout_s`, `fades_s` (of best
    places) and `declares`; for `estimate` also `near_m`, `near_s`, `unchanged_s` and `declare_factor` (how many times
    the floor the best place must have); for `met_gas` and `searching_centre_m` also `search_step_m`, `cast_m` and
    `n_casts`.

    State: the rounds, the pilot, the team's wind, its best place, the plume's memory, and what was declared.
    """

    now: Round

    def __init__(self, briefing: Briefing, settings: SimpleNamespace | None = None) -> None:
        """Join the team of a briefing, before the first round."""
        super().__init__(briefing, settings)
        s = self.settings
        nose, vane = find_noses(briefing)[0], next(iter(find_vanes(briefing)), None)
        smell = GasScale(nose, floor=s.gas_floor, band_frac=s.mox_band_frac)
        self.rounds = Rounds(briefing, nose, vane, amount=smell.amount, timeout_s=s.timeout_s, window_s=s.hold_s)
        self.pilot = LegPlanner(briefing, self.draws, margin_m=s.wall_margin_m)
        self.room = self.pilot.room
        self.wind = TrustedWind(threshold_m_s=s.calm_m_s)
        self.best: Sighting | None = None
        self._wind_m_s = np.zeros(2)
        self._memory: PlumeMemory | None = None
        # What was refused while it waits: the answer to a wait says nothing of the leg any more.
        self._notice: str | None = None
        self._rule: SwarmRule | None = None
        self.target_m: Floats = np.zeros(2)

    @property
    def index(self) -> int:
        """The robot's slot: its place among the sorted names of all members."""
        return self.rounds.index

    @property
    def n_members(self) -> int:
        """Number of robots of the team at the start."""
        return self.rounds.n_members

    @property
    def upwind_rad(self) -> float:
        """Direction from which the team's wind last came; 0 as long as it never had one [rad]."""
        return self.wind.upwind_rad or 0.0

    def observe(self, observation: Observation) -> None:
        """Read and listen: reports come with any observation."""
        self.rounds.observe(observation)
        self._notice = observation.notice or self._notice

    def continue_leg(self, observation: Observation) -> Command | None:
        """Return the command while the own leg is under way, and while others have not read yet."""
        command = self.pilot.continue_leg(observation)
        if command is not None:
            return command
        best = None if self.best is None else self.best.faded(observation.time_s, self.settings.fades_s)
        reported = None if best is None else ReportedBest(position_m=(*best.place_m, self.height_m), amount=best.amount)
        now = self.rounds.complete(observation, self.numbers(), best=reported)
        if now is None:
            return self.rounds.wait(observation)
        self.now = now
        return None

    def learn(self, observation: Observation) -> None:
        """Take in the round: the team's wind and best place, and where this robot goes unless it declares."""
        self.learn_round(self.now, observation.time_s)
        self.target_m = self.next_place_m(self.now)

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return the estimate of the source if the swarm's rule is satisfied."""
        s = self.settings
        if self.best is None or self.best.amount < s.declare_factor * s.gas_floor:
            return None
        if self._rule is None:
            self._rule = SwarmRule(radius_m=s.near_m, near_s=s.near_s, unchanged_s=s.unchanged_s)
        members_m = [(float(x), float(y)) for x, y in self.now.positions_m]
        return self._rule.add(observation.time_s, self.best.place_m, members_m)

    def declare(self, observation: Observation, found: Estimate) -> Command | None:
        """Return the declaration, which holds as long as a place is read."""
        command = super().declare(observation, found)
        return None if command is None else command.model_copy(update={"hold_s": self.settings.hold_s})

    def next_leg(self, observation: Observation) -> Command:
        """Return the leg to the next place, or as near to it as the room allows; another one where that was refused."""
        inside_m = self.room.nearest([float(x) for x in self.target_m[:2]])
        noted = observation.model_copy(update={"notice": self._notice})
        self._notice = None
        return self.pilot.leg(noted, inside_m, hold_s=self.settings.hold_s)

    def outgoing(self, observation: Observation) -> tuple[RadioMessage, ...]:
        """Return the last report: the others hear it with each answer."""
        return self.rounds.call()

    def numbers(self) -> tuple[float, ...]:
        """Return the method's own numbers that go with this robot's report."""
        return ()

    @abstractmethod
    def next_place_m(self, now: Round) -> Floats:
        """Return the next position of this robot after a round, (2,), world frame [m]."""

    def slots_of(self, now: Round) -> list[int]:
        """Return the slots of the robots of a round, in its order."""
        return [self.rounds.team.members.index(name) for name in now.names]

    def centre_of(self, now: Round, offsets_m: Floats) -> Floats:
        """Return the formation's centre (2,) [m], by where the robots of a round are and where they belong.

        Args:
            offsets_m: (n_members, 2) slots in world axes, by sorted names [m].
        """
        return centre_m(now.positions_m, offsets_m[self.slots_of(now)])

    def searching_centre_m(self, here_m: Floats, *, lane_m: float, inset_m: float) -> Floats:
        """Return the next centre of a formation without gas (2,): around the last gas, else along lanes [m]."""
        return self._plume_memory(lane_m, inset_m).next_place_m(here_m)

    def met_gas(self, here_m: Floats, *, lane_m: float, inset_m: float) -> None:
        """Take note that the formation has gas; when it is lost, the search begins here."""
        self._plume_memory(lane_m, inset_m).met_gas(here_m, self.upwind_rad)

    def _plume_memory(self, lane_m: float, inset_m: float) -> PlumeMemory:
        if self._memory is None:
            s = self.settings
            lanes_m = plan_crosswind_lanes(self.room, self.upwind_rad, lane_m, inset_m=inset_m)
            self._memory = PlumeMemory(lanes_m, step_m=s.search_step_m, cast_m=s.cast_m, n_casts=s.n_casts)
        return self._memory

    def learn_round(self, now: Round, time_s: float) -> None:
        """Take in the wind of the team, and the best place that any of it knows of."""
        share = _NEW_WIND_FRAC if self._wind_m_s.any() else 1.0
        self._wind_m_s = (1.0 - share) * self._wind_m_s + share * np.array(now.mean_wind_m_s)
        x_m_s, y_m_s = (float(v) for v in self._wind_m_s)
        self.wind.add(MeasuredWind(speed_m_s=norm2(x_m_s, y_m_s), upwind_rad=elementary.atan2(-y_m_s, -x_m_s)))
        known = [sighting for report in now.reports.values() for sighting in _sightings(report)]
        known += [] if self.best is None else [self.best]
        faded = [sighting.faded(time_s, self.settings.fades_s) for sighting in known]
        most = max(faded, key=lambda sighting: sighting.amount, default=None)
        self.best = most if most is not None and most.amount > self.settings.gas_floor else None


# What a report says of gas at places: its own reading, and the best place that it knows of.
def _sightings(report: Report) -> list[Sighting]:
    sightings = [Sighting((report.position_m[0], report.position_m[1]), report.amount, report.time_s)]
    best = report.best
    if best is None:
        return sightings
    return [*sightings, Sighting((best.position_m[0], best.position_m[1]), best.amount, report.time_s)]
