"""Fluxotaxis: a lattice of robots held by virtual forces, and the gas flux through it.

The mass flux at a robot is F = c W: the gas there times the wind vector. Through a closed ring flows what its inside
releases (the divergence theorem), so a ring tells whether the source is inside, wherever its maximum of gas lies.

Held by:
    extensions/search/tests/unit/swarms/test_fluxotaxis.py
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.scalar_kernels import norm2
from gslcosim_search import elementary
from gslcosim_search.swarms.formations import COLLINEAR_FRAC, PlaneFit, fit_plane

Floats = NDArray[np.float64]

# Neighbours are those within this many lattice distances: the next ring of a hexagonal lattice is at 1.73.
REACH = 1.5


def lattice_forces(positions_m: Floats, spacing_m: float, *, soft_m: float) -> Floats:
    """Return the virtual forces (n, 2) that make a hexagonal lattice of robots: apart when too near, else together.

    F_i = sum_j s(r_ij) (R / r_ij)^2 (p_j - p_i) / r_ij, over r_ij < 1.5 R
    s = clip((r - R) / h, -1, 1)
    [1] = [1]

    Args:
        positions_m: (n, 2) places [m].
        spacing_m: R, the distance at which neighbours rest [m].
        soft_m: h, the half width of the band around R in which the force passes zero [m].

    Returns:
        (n, 2) forces, 1 where one neighbour at the distance R pulls with all its strength.

    Source:
        Spears and Spears's physicomimetics, as in Zarzhitsky, Spears, Thayer 2005 (remembered, unverified).
    Deviation:
        The force passes zero in a band and does not jump there, so that robots which move in steps come to rest.
        Places nearer than a tenth of R count as a tenth of R.
    Held by:
        extensions/search/tests/unit/swarms/test_fluxotaxis.py (a hexagon is at rest; all forces together are zero)
    """
    apart_m = positions_m[None, :, :] - positions_m[:, None, :]
    distance_m = np.linalg.norm(apart_m, axis=-1)
    is_near = (distance_m < REACH * spacing_m) & (distance_m > 0.0)
    held_m = np.where(is_near, np.maximum(distance_m, 0.1 * spacing_m), np.inf)
    strength = np.clip((distance_m - spacing_m) / soft_m, -1.0, 1.0) * np.square(spacing_m / held_m) / held_m
    return np.sum(strength[..., None] * apart_m, axis=1)


def relaxed_lattice(positions_m: Floats, spacing_m: float, *, n_steps: int = 8, step_frac: float = 0.1) -> Floats:
    """Return the robots' positions (n, 2) after they follow the lattice's forces for some steps, without inertia.

    p <- p + q R F(p), n_steps times, with the soft band h = R / 4; then shifted so that the mean stays where it was

    Robots that know each other's places compute the same and fly to it in one leg.

    Source:
        Our first-order form of the physicomimetic lattice: legs have no inertia to damp.
    Held by:
        extensions/search/tests/unit/swarms/test_fluxotaxis.py (disturbed hexagons close again)
    """
    places_m = np.array(positions_m, dtype=np.float64)
    for _ in range(n_steps):
        places_m += step_frac * spacing_m * np.clip(lattice_forces(places_m, spacing_m, soft_m=spacing_m / 4), -2, 2)
    return places_m + (np.mean(positions_m, axis=0) - places_m.mean(axis=0))


@dataclass(frozen=True, kw_only=True)
class RingFlow:
    """Flow through a ring of robots: in and out, both positive, and what they leave. Unit: ppm m^2/s in 2-D."""

    inward: float
    outward: float

    @property
    def net(self) -> float:
        """Return the net flow out of the ring: outward less inward."""
        return self.outward - self.inward

    @property
    def released_frac(self) -> float:
        """Return the part of the outflow that comes from inside; 0 where less flows out than in."""
        return max(0.0, self.net) / self.outward if self.outward > 0.0 else 0.0


def ring_flow(positions_m: Floats, flux: Floats) -> RingFlow:
    """Return the flow through the ring that the robots form.

    Q = closed integral F . n dl = k sum_i F_i . m_i, k = (2 pi / n) / sin(2 pi / n)
    m_i = half of the outward normals of the two sides at robot i, each as long as its side
    [ppm m^2/s] = [ppm m/s] [m]

    The sum is the trapezoidal rule on the polygon; k makes the ring through the corners of a regular polygon of it.
    With k the rule is exact for a source in the middle of a regular ring, and for fluxes that change linearly.

    Args:
        positions_m: (n, 2) places, in any order; taken around their mean [m].
        flux: (n, 2) F = c W at these places [ppm m/s].

    Returns:
        The flow, zero for fewer than three robots. It is that through the walls of a prism of height 1 m: what leaves
        through its floor and lid is not seen.

    Source:
        Gauss's theorem; as a rule of declaration, Zarzhitsky and Spears 2005 (remembered, unverified).
    Deviation:
        Robots inside the ring, such as one in the middle, are left out.
    Held by:
        extensions/search/tests/unit/swarms/test_fluxotaxis.py (a source inside gives its strength, one outside gives
        zero)
    """
    around = _ring_order(positions_m) if len(positions_m) >= 3 else ()
    n = len(around)
    if n < 3:
        return RingFlow(inward=0.0, outward=0.0)
    places_m, flux = positions_m[list(around)], flux[list(around)]
    chord_m = np.roll(places_m, -1, axis=0) - np.roll(places_m, 1, axis=0)
    normal_m = 0.5 * np.column_stack((chord_m[:, 1], -chord_m[:, 0]))
    through = np.sum(flux * normal_m, axis=1) * (2.0 * math.pi / n) / elementary.sin(2.0 * math.pi / n)
    return RingFlow(inward=float(-through[through < 0.0].sum()), outward=float(through[through > 0.0].sum()))


def inflow_direction(positions_m: Floats, flux: Floats) -> Floats | None:
    """Return the unit direction (2,) from which gas flows into a ring, or None where none does.

    d = sum_i max(0, -F_i . r_i) r_i, made a unit vector        r_i unit vector from the ring's mean place to robot i

    It leads up the wind, and of the ring's upwind side to where most gas comes in.

    Args:
        positions_m: (n, 2) places, in any order [m].
        flux: (n, 2) F = c W at these places [ppm m/s].

    Source:
        Following the flux upstream, as Zarzhitsky and Spears (remembered, unverified); the weights are ours.
    """
    if len(positions_m) < 2:
        return None
    away_m = positions_m - positions_m.mean(axis=0)
    distance_m = np.linalg.norm(away_m, axis=1)
    outward = away_m / np.maximum(distance_m, 1e-9)[:, None]
    inward = np.maximum(0.0, -np.sum(flux * outward, axis=1))
    towards = np.sum((inward * (distance_m > 0.5 * distance_m.max()))[:, None] * outward, axis=0)
    size = norm2(towards[0], towards[1])
    return towards / size if size > 1e-12 else None


def flux_divergence(positions_m: Floats, flux: Floats, reach_m: float) -> Floats:
    """Return the divergence of the flux at each robot (n,), from planes through it and its neighbours.

    D_i = dFx/dx + dFy/dy of the planes fitted to Fx and Fy at all robots within reach of robot i
    [ppm/s] = [ppm m/s] / [m]

    Args:
        positions_m: (n, 2) places, world frame [m].
        flux: (n, 2) F = c W at these places [ppm m/s].

    Returns:
        The divergences; NaN where the neighbours do not span a plane.

    Source:
        Zarzhitsky, Spears, Thayer 2005 (remembered, unverified).
    Deviation:
        They sum c_j W_j . n_j over the neighbours; at the lattice's edge these lie on one side, and the sum then tells
        the flux and not its divergence. The planes have no such bias.
    Held by:
        extensions/search/tests/unit/swarms/test_fluxotaxis.py (exact for linear fluxes)
    """
    apart_m = positions_m[:, None] - positions_m[None]
    is_near = np.linalg.norm(apart_m, axis=-1) <= reach_m
    means_m = elementary.product(is_near, positions_m) / is_near.sum(axis=1)[:, None]
    rows = (positions_m[None] - means_m[:, None]) * is_near[..., None]
    normal = (rows[..., None] * rows[..., None, :]).sum(axis=1)
    moments = (rows[..., None] * flux[:, None]).sum(axis=1)
    (xx, xy), (_, yy) = normal[:, 0].T, normal[:, 1].T
    determinant = xx * yy - xy * xy
    # As in a plane fit: the spreads of the places along and across, whose squares have this product and this sum.
    spans_plane = determinant > np.square(COLLINEAR_FRAC * (xx + yy))
    sum_of_slopes = yy * moments[:, 0, 0] - xy * (moments[:, 1, 0] + moments[:, 0, 1]) + xx * moments[:, 1, 1]
    return np.where(spans_plane, sum_of_slopes / np.where(spans_plane, determinant, 1.0), np.nan)


def divergence_slope(positions_m: Floats, flux: Floats, reach_m: float) -> PlaneFit:
    """Return the plane through the flux divergences of a lattice: it rises towards where gas comes from.

    G = grad(div F), by a plane through D_i
    [ppm/(s m)] = [ppm/s] / [m]

    Returns:
        The plane; without a gradient where fewer than three robots have a divergence, as in a lattice in which
        every robot is everyone's neighbour: there the divergences are all the same one.

    Source:
        The gradient of the mass flux of Zarzhitsky and Spears (remembered, unverified).
    Held by:
        extensions/search/tests/unit/swarms/test_fluxotaxis.py (it points to the source)
    """
    divergence = flux_divergence(positions_m, flux, reach_m)
    is_known = np.isfinite(divergence)
    known = divergence[is_known]
    if len(known) >= 3 and np.ptp(known) <= 1e-12 * np.abs(known).max(initial=0.0):
        return PlaneFit(mean=float(known.mean()), gradient_per_m=None, problem="all divergences are the same one.")
    return fit_plane(positions_m[is_known], known)


class OutflowRule:
    """Says when a team has its source: for several rounds running, most of what leaves the ring begins in it.

    State: how many rounds running it held, and the places of the ring's centre in them.

    Source:
        Zarzhitsky and Spears (the theorem as a rule; share and number of rounds are ours).
    """

    def __init__(self, *, least_frac: float, least_flow: float, n_rounds: int) -> None:
        """Prepare the rule.

        Args:
            least_frac: The part of the outflow that must come from inside.
            least_flow: Net flow below which nothing is said [ppm m^2/s].
        """
        self._least_frac, self._least_flow, self._n_rounds = least_frac, least_flow, n_rounds
        self._centres_m: list[tuple[float, float]] = []
        self._shares: list[float] = []

    @property
    def is_holding(self) -> bool:
        """True if the last round spoke for a source inside: the ring should stay and read again, until that is sure."""
        return 0 < len(self._shares) <= self._n_rounds

    def declared(self, flow: RingFlow, centre_m: Floats) -> tuple[tuple[float, float], float] | None:
        """Take a round's flow; return place and confidence once the rule holds.

        The place is the mean of the centres of these rounds, the confidence the mean of their shares.
        """
        if flow.net < self._least_flow or flow.released_frac < self._least_frac:
            self._centres_m.clear()
            self._shares.clear()
            return None
        self._centres_m.append((float(centre_m[0]), float(centre_m[1])))
        self._shares.append(flow.released_frac)
        if len(self._shares) < self._n_rounds:
            return None
        x_m, y_m = np.mean(self._centres_m[-self._n_rounds :], axis=0)
        return (float(x_m), float(y_m)), float(np.mean(self._shares[-self._n_rounds :]))


# Counter-clockwise around the mean, without those nearer to it than half of the others' mean distance.
def _ring_order(positions_m: Floats) -> tuple[int, ...]:
    from_mean_m = positions_m - np.mean(positions_m, axis=0)
    distance_m = np.linalg.norm(from_mean_m, axis=1)
    is_around = distance_m > 0.5 * distance_m.max(initial=0.0)
    angles_rad = elementary.atan2_each(from_mean_m[:, 1], from_mean_m[:, 0])
    return tuple(int(i) for i in np.argsort(angles_rad, kind="stable") if is_around[i])
