"""Particle swarm optimisation for robots: velocities from bests, limits, repulsion, wind rules, fading bests.

All are pure functions of given random numbers; a velocity is a step [m per iteration], vectors are (d,) float64 arrays.

Held by:
    extensions/search/tests/unit/swarms/test_particle_swarm.py
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim_search import elementary

Vector = NDArray[np.float64]
_LEAST_M = 1e-9


@dataclass(frozen=True, kw_only=True)
class SwarmWeights:
    """Weights of a particle: of its velocity (`inertia`), and of the pull to its own best and the swarm's."""

    inertia: float
    own: float
    swarm: float


def pso_velocity(
    velocity_m: Vector,
    place_m: Vector,
    own_best_m: Vector,
    swarm_best_m: Vector,
    *,
    weights: SwarmWeights,
    draws: Vector,
) -> Vector:
    """Return the next velocity of a particle.

    v' = w v + phi_p r_p o (p - x) + phi_g r_g o (g - x)        o: element by element
    [m] = [1] [m] + [1] [1] [m] + [1] [1] [m]; velocities are steps of one iteration

    Args:
        velocity_m: (d,) v, the last step [m].
        place_m: (d,) x, where the particle is, world frame [m].
        own_best_m: (d,) p, the best place it has been at, world frame [m].
        swarm_best_m: (d,) g, the best place of all, world frame [m].
        weights: w, phi_p, phi_g.
        draws: (2, d) r_p and r_g, random numbers in [0, 1), one for each dimension.

    Returns:
        (d,) v' [m]; a new array.

    Source:
        Kennedy and Eberhart 1995, doi:10.1109/ICNN.1995.488968; for robots Jatmiko, Sekiyama, Fukuda 2007.
    Held by:
        extensions/search/tests/unit/swarms/test_particle_swarm.py (iterates worked out by hand)
    """
    own_draws, swarm_draws = draws
    to_own, to_swarm = own_best_m - place_m, swarm_best_m - place_m
    return weights.inertia * velocity_m + weights.own * own_draws * to_own + weights.swarm * swarm_draws * to_swarm


def limit_length(velocity_m: Vector, longest_m: float) -> Vector:
    """Return a step of the same direction that is no longer than a robot's leg [m]; a new array."""
    length_m = float(np.linalg.norm(velocity_m, axis=0))
    return velocity_m * (longest_m / length_m) if length_m > longest_m else velocity_m.copy()


def scale_to_length(velocity_m: Vector, length_m: float) -> Vector:
    """Return a step of the same direction and a given length [m]; one of no length stays so."""
    now_m = float(np.linalg.norm(velocity_m, axis=0))
    return velocity_m * (length_m / now_m) if now_m > _LEAST_M else np.zeros_like(velocity_m)


def repelled_velocity(
    velocity_m: Vector, place_m: Vector, others_m: Vector, *, within_m: float, leg_m: float
) -> Vector | None:
    """Return the step that leads away from neighbours, which is taken in place of the swarm's; None without any.

    v' = l u / |u|,  u = v + sum over |x - x_j| < d of (x - x_j)        [m] = [m] + [m]

    Args:
        velocity_m: (d,) v, the last step [m].
        place_m: (d,) x, world frame [m].
        others_m: (n, d) x_j, the other robots, world frame [m].
        within_m: d, who is nearer repels [m].
        leg_m: l, the length of the step [m].

    Source:
        GSL-Bench, read in code.
    Deviation:
        The sum may be nothing, where the robots stand in each other or the last step undoes it: then v' is zero.
    """
    away_m = place_m - others_m.reshape(-1, len(place_m))
    near = np.linalg.norm(away_m, axis=1) < within_m
    return scale_to_length(velocity_m + away_m[near].sum(axis=0), leg_m) if near.any() else None


@dataclass(frozen=True, kw_only=True)
class Charge:
    """Repulsion of charged particles: Q^2 [m^3 per iteration], the core and the reach [m]."""

    squared_m3: float
    core_m: float
    reach_m: float


def charge_velocity(place_m: Vector, others_m: Vector, charge: Charge) -> Vector:
    """Return the velocity that the other charged particles add to a charged particle.

    a = sum over j of Q^2 (x - x_j) / (r_core^2 d)    where d < r_core,        d = |x - x_j|
                      Q^2 (x - x_j) / d^3             where r_core <= d <= r_perc, 0 beyond
    [m] = [m^3] [m] / [m^3]: Q^2 is per iteration

    The size is Q^2 / r_core^2 in the core and Q^2 / d^2 outside: continuous at r_core.

    Args:
        place_m: (d,) x, world frame [m].
        others_m: (n, d) x_j, the other charged particles, world frame [m].
        charge: Q^2, r_core, r_perc.

    Returns:
        (d,) a [m per iteration].

    Source:
        Blackwell and Bentley 2002 (GECCO), as in equation 4.1 of the thesis on GSL-Bench.
    Deviation:
        One exactly in the same place does not push, for want of a direction.
    """
    away_m = place_m - others_m.reshape(-1, len(place_m))
    distances_m = np.linalg.norm(away_m, axis=1)
    pushes = (distances_m <= charge.reach_m) & (distances_m > _LEAST_M)
    away_m, distances_m = away_m[pushes], distances_m[pushes]
    push = charge.squared_m3 / (np.square(np.maximum(distances_m, charge.core_m)) * distances_m)
    return (push[:, None] * away_m).sum(axis=0)


def angle_to_downwind_rad(velocity_m: Vector, wind_m_s: Vector) -> float:
    """Return the angle from downwind to a step, counter-clockwise, in (-pi, pi]; 0 where one of the two is nothing.

    alpha = atan2(W x v, W . v)        [rad]; W where the air goes, both (2,), world frame
    """
    cross = wind_m_s[0] * velocity_m[1] - wind_m_s[1] * velocity_m[0]
    return elementary.atan2(cross, float(wind_m_s[0] * velocity_m[0] + wind_m_s[1] * velocity_m[1]))


def rotate_out_of_downwind(velocity_m: Vector, wind_m_s: Vector, forbidden_rad: float) -> Vector:
    """Return a step that is not in the forbidden cone about downwind: turned to the edge of the cone if it was.

    v' = R(sign(alpha) max(theta - |alpha|, 0)) v        alpha from downwind to v, theta the cone's half angle [rad]

    WU-I. Exactly downwind it turns left. In calm air (W = 0) nothing is forbidden.

    Args:
        velocity_m: (2,) v [m].
        wind_m_s: (2,) W, where the air goes, world frame [m/s].
        forbidden_rad: theta, from 0 to pi [rad].

    Source:
        Jatmiko, Sekiyama, Fukuda 2007, the idea; angles of 60 to 90 degrees are remembered, unverified.
    """
    if not wind_m_s.any() or not velocity_m.any():
        return velocity_m.copy()
    angle_rad = angle_to_downwind_rad(velocity_m, wind_m_s)
    missing_rad = max(0.0, forbidden_rad - abs(angle_rad))
    return rotate(velocity_m, missing_rad if angle_rad >= 0.0 else -missing_rad)


def shorten_downwind(velocity_m: Vector, wind_m_s: Vector) -> Vector:
    """Return a step that is the shorter the more it goes down the wind.

    v' = chi v,  chi = (1 - cos alpha) / 2        alpha the angle between v and downwind; 0 downwind, 1 upwind

    WU-II. In calm air chi is 1.

    Args:
        velocity_m: (2,) v [m].
        wind_m_s: (2,) W, where the air goes, world frame [m/s].

    Source:
        Jatmiko, Sekiyama, Fukuda 2007, the idea; this chi is chosen (the paper's is not known to us).
    """
    if not wind_m_s.any():
        return velocity_m.copy()
    return velocity_m * (1.0 - elementary.cos(angle_to_downwind_rad(velocity_m, wind_m_s))) / 2.0


def rotate(vector: Vector, angle_rad: float) -> Vector:
    """Return a (2,) vector turned counter-clockwise."""
    cos, sin = elementary.cos(angle_rad), elementary.sin(angle_rad)
    return np.array([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])


def fade_amount(amount: float, age_s: float, fades_s: float) -> float:
    """Return the faded amount of a best reading, so that robots do not follow gas that has gone for ever.

    f' = f exp(-dt / tau)        tau 0 or less: it does not fade

    Source:
        Our choice for gas that changes with time; tau of 60 s is remembered, unverified.
    """
    return amount * elementary.exp(-max(0.0, age_s) / fades_s) if fades_s > 0.0 else amount


@dataclass(frozen=True)
class Sighting:
    """Amount of gas at a position (x, y) and a time. Fixed: a best does not move with the robot that found it."""

    place_m: tuple[float, float]
    amount: float
    time_s: float

    def faded(self, now_s: float, fades_s: float) -> "Sighting":
        """Return the sighting with its faded amount."""
        return Sighting(self.place_m, fade_amount(self.amount, now_s - self.time_s, fades_s), now_s)


def better(old: Sighting | None, new: Sighting | None, *, fades_s: float = 0.0) -> Sighting | None:
    """Return the better of two sightings at the time of the new one: the old one unless the new one has more gas."""
    if old is None or new is None:
        return old or new
    return new if new.amount > old.faded(new.time_s, fades_s).amount else old


class Stagnation:
    """Counts the iterations for which a swarm's best has not got better, as DR-PSO does to detect a change.

    Source:
        Jatmiko, Sekiyama, Fukuda 2007 (detection and response); 10 to 20 iterations are remembered, unverified.
    """

    def __init__(self, n_patient: int) -> None:
        """Begin without a best; `n_patient` iterations without a better one are a change."""
        self._n_patient = n_patient
        self._best: Sighting | None = None
        self.n_unchanged = 0

    def note(self, best: Sighting | None) -> bool:
        """Take the best of an iteration; return whether it has been the same for too long, and count again then."""
        is_same = best is not None and self._best is not None and best.place_m == self._best.place_m
        self.n_unchanged = self.n_unchanged + 1 if is_same else 0
        self._best = best
        if self.n_unchanged < self._n_patient:
            return False
        self._best, self.n_unchanged = None, 0
        return True
