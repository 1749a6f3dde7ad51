# pyright: basic
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
"""Buoyancy: a gas or heat that the wind carries and that drives it, its releases and warm surfaces, and small holes.

The density enters the momentum equation only (Boussinesq): air moves up with b = g' s, s the volume fraction of the gas
or the excess temperature. Padding and index order are those of `pressure`; the scalar is at cell centres.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import FlowError
from gslcosim.base.quantities import GRAVITY_M_S2, Vec3
from gslcosim.flow.domain import Domain
from gslcosim.flow.patches import Outlet
from gslcosim.flow.pressure import F32, HIGH, LOW, padded
from gslcosim.flow.turbulence import KEpsilon, Laminar, TurbulenceModel, Velocity, transport_scalar

Floats = NDArray[np.float64]
AIR_KG_M3 = 1.2
AIR_K = 293.0
HEAT_M2_S = 2.1e-5
# Of a sharp-edged hole, from 0.60 to 0.65 in handbooks; ISO 5167-2:2003 has 0.596 + corrections.
DISCHARGE = 0.61
# Spalding's value for jets; 0.5 to 0.9 in the literature.
TURBULENT_SCHMIDT = 0.7
# Of a top-hat plume: Morton, Taylor and Turner 1956 and later measurements, 0.09 to 0.13.
ENTRAINMENT = 0.1
_STRIPS = 12  # of a hole, over its height
_BLOCK = 1  # cells to each side from which a plume entrains air
_STEPS_PER_CELL = 16
# Fraction of the time in which the lightest air of a cell would cross it, and in which a cell's volume is exchanged;
# chosen.
_STEP_SHARE = 0.7
_INNER = (slice(LOW, -HIGH),) * 3


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A part of a wall, floor, ceiling or obstacle that gives off the scalar: a flat box in the grid's frame [m].

    Attributes:
        scalar_m3_s: Scalar times volume per time that it gives off evenly [unit m3/s]. With a `value` an estimate, from
            which solves derive how long statistics take to settle.
        value: Of the scalar at it; None: it gives off `scalar_m3_s` whatever the air.
        find_exchange_m_s: Returns the flux over the excess of the value from (n,) excesses over the air of the cells,
            (n,) factors of their wall friction [m/s], and 1, -1 or 0 for air above, below or beside it. Molecular
            diffusion over half a cell is the least, and all of it in laminar flow, whose cells resolve the layer.
    """

    min_m: Vec3
    max_m: Vec3
    scalar_m3_s: float = 0.0
    value: float | None = None
    find_exchange_m_s: Callable[[Floats, Floats, int], Floats] | None = None


@dataclass(frozen=True, kw_only=True)
class Release:
    """A source in one cell: scalar times volume per time [unit m3/s], and the volume released with it [m3/s].

    For a leak both are its volume flow; for heat P / (rho c_p) [K m3/s] without volume.

    With `area_m2`, that of a round opening that points upwards, the release rises as a plume that is narrower than
    cells: it entrains air on its way, and is put into cells where it is three cells wide, no longer light, or at the
    ceiling.
    """

    position_m: Vec3
    scalar_m3_s: float
    volume_m3_s: float = 0.0
    area_m2: float | None = None


@dataclass(frozen=True, kw_only=True)
class Orifice:
    """A hole to still air outside, smaller than a cell: flow in both directions by the pressure at each height.

    Attributes:
        centre_m: In the cell from which air leaves and into which it enters [m].
        height_m: From its lower to its upper edge [m].
        area_m2: Area [m2].
        discharge: Flow over that of Bernoulli without loss.
    """

    centre_m: Vec3
    height_m: float
    area_m2: float
    discharge: float = DISCHARGE


@dataclass(frozen=True, kw_only=True)
class BuoyantScalar:
    """Scalar that the wind carries and that drives it, with its sources; zero is the outside air.

    Attributes:
        buoyancy_m_s2: Upward acceleration per unit of the scalar, g' [m/s2].
        diffusivity_m2_s: Molecular diffusivity [m2/s].
        turbulent_schmidt: Eddy viscosity over eddy diffusivity.
        density_ratio: Density of the pure gas over that of air, for flow through holes; 1 for heat.
        start: Value at the start.
        surfaces: Surfaces that give it off or take it up.
        releases: Sources.
        orifices: Holes, in a box without inlet and outlet only.
    """

    buoyancy_m_s2: float
    diffusivity_m2_s: float
    turbulent_schmidt: float = TURBULENT_SCHMIDT
    density_ratio: float = 1.0
    start: float = 0.0
    surfaces: Sequence[Surface] = ()
    releases: Sequence[Release] = ()
    orifices: Sequence[Orifice] = ()

    @classmethod
    def of_gas(cls, density_kg_m3: float, diffusivity_m2_s: float, **others: Any) -> Self:
        """Return the scalar of a gas of given density, as volume fraction: g' = g (1 - rho / rho_air)."""
        if not 0 < density_kg_m3 < 100:
            raise FlowError(
                f"density_kg_m3: expected a density of a gas [kg/m3], was {density_kg_m3}; helium has 0.166."
            )
        ratio = density_kg_m3 / AIR_KG_M3
        buoyancy_m_s2 = GRAVITY_M_S2 * (1 - ratio)
        return cls(buoyancy_m_s2=buoyancy_m_s2, diffusivity_m2_s=diffusivity_m2_s, density_ratio=ratio, **others)

    @classmethod
    def of_heat(cls, diffusivity_m2_s: float = HEAT_M2_S, *, air_k: float = AIR_K, **others: Any) -> Self:
        """Return the scalar of warm air, as temperature excess over the air [K]: g' = g / T."""
        return cls(buoyancy_m_s2=GRAVITY_M_S2 / air_k, diffusivity_m2_s=diffusivity_m2_s, **others)


@numba.njit(cache=True, nogil=True)
def push_by_buoyancy(scalar, coefficient, acceleration_m_s2, dt_s, stage_weight, out):
    """Add the buoyancy to the z-velocities of open faces, in place: out += g_stage dt g' s, s the mean of both cells.

    [m/s] = [s] [m/s2]

    Args:
        scalar: Padded scalar.
        coefficient: Padded coefficients of the low-z faces.
        acceleration_m_s2: g' [m/s2].
        dt_s: Time step [s].
        stage_weight: g_stage of the Runge-Kutta stage.
        out: Padded z-velocities at its end [m/s], modified.

    Held by: tests/analytic/flow/test_heated_cavity.py
    """
    nx, ny, nz = scalar.shape
    factor = np.float32(0.5 * stage_weight * dt_s * acceleration_m_s2)
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH + 1):
                push = factor * (scalar[i, j, k - 1] + scalar[i, j, k])
                out[i, j, k] += push if coefficient[i, j, k] > 0 else np.float32(0)


@numba.njit(cache=True, nogil=True)
def stratification(scalar, nu, acceleration_m_s2, cell_m, out):
    """Write N^2 = g' ds/dz [1/s2] of air cells, central where both neighbours are air, else one-sided.

    Args:
        scalar: Padded scalar.
        nu: Padded viscosity; 0 marks cells that are not air.
        acceleration_m_s2: g' [m/s2].
        cell_m: Edge of a cell [m].
        out: Written: padded N^2.
    """
    nx, ny, nz = scalar.shape
    factor = np.float32(acceleration_m_s2 / cell_m)
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                above = k + 1 if nu[i, j, k + 1] > 0 else k
                below = k - 1 if nu[i, j, k - 1] > 0 else k
                steps = np.float32(max(above - below, 1))
                out[i, j, k] = factor * (scalar[i, j, above] - scalar[i, j, below]) / steps


@numba.njit(cache=True, nogil=True)
def largest_step(scalar, air):
    """Return the largest difference of the scalar between two air cells that touch."""
    nx, ny, nz = scalar.shape
    largest = np.float32(0)
    for i in range(LOW, nx - HIGH):
        for j in range(LOW, ny - HIGH):
            for k in range(LOW, nz - HIGH):
                here = scalar[i, j, k]
                for other in range(3):
                    a, b, c = i + (other == 0), j + (other == 1), k + (other == 2)
                    if air[i, j, k] and air[a, b, c]:
                        largest = max(largest, abs(scalar[a, b, c] - here))
    return largest


@numba.njit(cache=True, nogil=True)
def flows_through_holes(head, share, area_m2, density_ratio, net_m3_s, outward_m3_s):
    """Find the pressure at which the outflow through holes equals the release, and the flow through each strip of them.

    u = sqrt(2 |p0 + head| / rho*),   sum of A u = net,   rho* the density of what flows over that of air
    [m/s] = [m2/s2]^(1/2)

    Args:
        head: (n,) buoyancy integrated from the floor to each strip [m2/s2].
        share: (n,) volume fraction of the gas inside, at each strip.
        area_m2: (n,) area of each strip times its discharge coefficient [m2].
        density_ratio: Density of the pure gas over that of air.
        net_m3_s: Net outflow [m3/s].
        outward_m3_s: Written: (n,) flow through each strip, above 0 outwards [m3/s].

    Source: Bernoulli with hydrostatic pressure; Linden 1999, doi:10.1146/annurev.fluid.31.1.201, section 2.
    Held by: tests/unit/flow/test_buoyancy.py (one hole, two holes)
    """
    reach = 1.0 + (net_m3_s / np.sum(area_m2)) * (net_m3_s / np.sum(area_m2)) + np.max(np.abs(head))
    low, high = -np.max(head) - reach, -np.min(head) + reach
    for _ in range(80):
        pressure = 0.5 * (low + high)
        total = 0.0
        for n in range(head.shape[0]):
            drop = pressure + head[n]
            density = 1.0 - (1.0 - density_ratio) * share[n] if drop > 0 else 1.0
            speed = np.sqrt(2.0 * abs(drop) / density)
            outward_m3_s[n] = area_m2[n] * speed if drop > 0 else -area_m2[n] * speed
            total += outward_m3_s[n]
        if total > net_m3_s:
            high = pressure
        else:
            low = pressure


@numba.njit(cache=True, nogil=True)
def rise_of_plume(ambient, first_m, cell_m, volume, scalar, momentum, acceleration_m_s2, widest_m, entrained):
    """Let a plume rise through layers until it is wide, no longer light, or at the last one.

    dQ/dz = 2 alpha (pi M)^(1/2),  dM/dz = g' (G / Q - s) Q^2 / M,  dG/dz = s dQ/dz
    [m2/s], [m3/s2], [unit m2/s];   Q = pi b^2 w volume, M = pi b^2 w^2 momentum, G scalar flux, s outside; width 2 b

    Args:
        ambient: (n,) scalar of the layers outside, from that of the source upwards.
        first_m: From the source to the upper end of its layer [m].
        cell_m: Height of the other layers [m].
        volume: Q at the source [m3/s].
        scalar: G at the source [unit m3/s].
        momentum: M at the source [m4/s2].
        acceleration_m_s2: g' [m/s2].
        widest_m: Width at which it ends [m].
        entrained: Written: (n,) volume entrained from each layer [m3/s].

    Returns:
        (index of the layer where it ends, its volume [m3/s] and scalar flux [unit m3/s] there).

    Source: Morton, Taylor and Turner 1956, doi:10.1098/rspa.1956.0011, equations 5 to 7 in top-hat form.
    Held by: tests/unit/flow/test_buoyancy.py (volume of a plume from a point)
    """
    entrained[:] = 0
    for k in range(ambient.shape[0]):
        step_m = (first_m if k == 0 else cell_m) / _STEPS_PER_CELL
        for _ in range(_STEPS_PER_CELL):
            # Midpoint rule; all rates from the middle of the step.
            push = acceleration_m_s2 * (scalar / volume - ambient[k]) * volume * volume / momentum
            intake = 2 * ENTRAINMENT * np.sqrt(np.pi * momentum)
            half_momentum = momentum + 0.5 * step_m * push
            if half_momentum <= 0:
                return k, volume, scalar
            half_volume = volume + 0.5 * step_m * intake
            half_scalar = scalar + 0.5 * step_m * intake * ambient[k]
            push = acceleration_m_s2 * (half_scalar / half_volume - ambient[k]) * half_volume * volume / half_momentum
            intake = 2 * ENTRAINMENT * np.sqrt(np.pi * half_momentum)
            if momentum + step_m * push <= 0:
                return k, volume, scalar
            momentum += step_m * push
            volume += step_m * intake
            scalar += step_m * intake * ambient[k]
            entrained[k] += step_m * intake
        if 2 * volume / np.sqrt(np.pi * momentum) > widest_m:
            return k, volume, scalar
    return ambient.shape[0] - 1, volume, scalar


def find_surface_cells(
    min_m: Vec3, max_m: Vec3, air: NDArray[np.bool_], cell_m: float
) -> tuple[NDArray[np.int64], int]:
    """Find the cells of padded `air` beside a solid whose centres a flat box covers, by its corners, grid's frame [m].

    Returns:
        (n,) flat padded indices, and 1 where the air is above the solid, -1 below it, 0 beside it.

    Raises:
        FlowError: there is no such cell.
    """
    axis = int(np.argmin(np.subtract(max_m, min_m)))
    covered: list[NDArray[np.bool_]] = []
    for low_m, high_m, n in zip(min_m, max_m, air.shape):
        centres_m = (np.arange(n) - LOW + 0.5) * cell_m
        covered.append((centres_m >= low_m - 1e-6) & (centres_m <= high_m + 1e-6))
    first = LOW + round(min_m[axis] / cell_m)
    for inwards, inside in ((1, first), (-1, first - 1)):
        covered[axis] = np.arange(air.shape[axis]) == inside
        beside = air & ~np.roll(air, inwards, axis=axis)
        cells = np.flatnonzero(beside & covered[0][:, None, None] & covered[1][:, None] & covered[2])
        if cells.size:
            return cells, inwards if axis == 2 else 0
    raise FlowError(
        f"surface from {min_m} to {max_m} m: expected a flat box on a wall, the floor, the ceiling or an obstacle that "
        f"covers the centre of a cell of {cell_m:g} m, was none."
    )


class _PlacedSurface:
    # A surface with the cells of air beside it, without those behind openings, and their places among the wall cells.
    def __init__(self, surface: Surface, domain: Domain) -> None:
        beside, self._upward = find_surface_cells(surface.min_m, surface.max_m, domain.air, domain.cell_m)
        self._cells = np.intersect1d(beside, domain.friction.cells)
        self._owners = np.searchsorted(domain.friction.cells, self._cells)
        self._surface, self._cell_m = surface, domain.cell_m
        self.scalar_m3_s = surface.scalar_m3_s / max(self._cells.size, 1)

    # Add to `new` what the surface gives to each cell.
    def give(self, old: F32, new: F32, model: TurbulenceModel, diffusivity_m2_s: float, dt_s: float) -> None:
        surface, cell_m = self._surface, self._cell_m
        given: Any = dt_s * self.scalar_m3_s / (cell_m * cell_m * cell_m)
        if surface.value is not None:
            excess = surface.value - old.reshape(-1)[self._cells].astype(np.float64)
            exchange_m_s: Any = 2 * diffusivity_m2_s / cell_m
            if surface.find_exchange_m_s is not None and not isinstance(model, Laminar):
                wall_m_s = surface.find_exchange_m_s(excess, model.friction_m_s[self._owners], self._upward)
                exchange_m_s = np.maximum(exchange_m_s, wall_m_s)
            given = dt_s / cell_m * exchange_m_s * excess
        new.reshape(-1)[self._cells] += np.float32(given)


class _Plume:
    # A release that rises as a plume through the block of cells around its column.
    def __init__(self, release: Release, area_m2: float, cell: tuple[int, int, int], domain: Domain) -> None:
        i, j, k = cell
        self.release, self._area_m2 = release, area_m2
        self._cell_m = domain.cell_m
        air = domain.air
        above = air[i, j, k:]
        n_layers = int(np.argmin(above)) if not above.all() else above.size
        self._layers = np.arange(k, k + n_layers)
        block = (slice(i - _BLOCK, i + _BLOCK + 1), slice(j - _BLOCK, j + _BLOCK + 1), slice(k, k + n_layers))
        self._block = block
        self._air = air[block].astype(np.float32)
        self._n_air = self._air.sum(axis=(0, 1))
        self._first_m = (k - LOW + 1) * domain.cell_m - release.position_m[2]
        self._entrained = np.zeros(n_layers)
        self.intake = np.zeros_like(self._air)
        self.outlet = np.zeros_like(self._air)
        self.scalar_m3_s = 0.0

    # Find the rise in the present scalar: `intake` and `outlet` are volumes of the block's cells per second.
    def rise(self, values: F32, acceleration_m_s2: float, share: float) -> None:
        release = self.release
        volume = share * release.volume_m3_s
        self.intake[:] = 0
        self.outlet[:] = 0
        self.scalar_m3_s = share * release.scalar_m3_s
        if not volume:
            return
        ambient = (values[self._block] * self._air).sum(axis=(0, 1), dtype=np.float64) / self._n_air
        momentum = volume * volume / self._area_m2
        widest_m = (2 * _BLOCK + 1) * self._cell_m
        top, volume, self.scalar_m3_s = rise_of_plume(
            ambient, self._first_m, self._cell_m, volume, self.scalar_m3_s, momentum, acceleration_m_s2, widest_m,
            self._entrained,
        )  # fmt: skip
        self.intake[:] = self._air * (self._entrained / self._n_air).astype(np.float32)
        self.outlet[..., top] = self._air[..., top] * np.float32(volume / self._n_air[top])

    # Remove the entrained scalar from `new`, and release it at the end, with that of the source.
    def carry(self, old: F32, new: F32, dt_s: float) -> None:
        per_volume = np.float32(dt_s / (self._cell_m * self._cell_m * self._cell_m))
        taken = self.intake * old[self._block]
        new[self._block] -= per_volume * taken
        released_m3_s = self.scalar_m3_s
        total = self.outlet.sum(dtype=np.float64)
        if total > 0:
            new[self._block] += per_volume * self.outlet * np.float32(released_m3_s / total)

    def add_volume(self, source_m_s: F32) -> None:
        source_m_s[self._block] += (self.outlet - self.intake) / np.float32(self._cell_m * self._cell_m)

    @property
    def largest_m3_s(self) -> float:
        return float(max(self.intake.max(), self.outlet.max()))


class Buoyancy:
    """State of a buoyant scalar in a domain: its values, the flow through its holes, and its effect on the wind."""

    def __init__(self, domain: Domain, scalar: BuoyantScalar) -> None:
        """Place surfaces, releases and holes on the grid."""
        self.scalar = scalar
        self._domain, self._height_m = domain, domain.shape[2] * domain.cell_m
        self.values = np.where(domain.air, np.float32(scalar.start), np.float32(0))
        self.source_m_s: F32 | None = None
        self._next = padded(domain.shape)
        self._stratification = padded(domain.shape)
        self._surfaces = [_PlacedSurface(surface, domain) for surface in scalar.surfaces]
        placed = [(_cell_of(r.position_m, domain, "release"), r) for r in scalar.releases]
        self._releases = [(cell, release) for cell, release in placed if release.area_m2 is None]
        self._plumes = [_Plume(r, r.area_m2, cell, domain) for cell, r in placed if r.area_m2 is not None]
        self._holes = [(_cell_of(o.centre_m, domain, "orifice"), o) for o in scalar.orifices]
        self.released_m3_s = sum(r.volume_m3_s for r in scalar.releases)
        _check_exits(domain, scalar, self.released_m3_s)
        heights = (np.arange(_STRIPS) + 0.5) / _STRIPS - 0.5
        self._strip_z_m = np.array([o.centre_m[2] + o.height_m * heights for o in scalar.orifices]).reshape(-1)
        self._strip_area_m2 = np.repeat([o.discharge * o.area_m2 / _STRIPS for o in scalar.orifices], _STRIPS)
        self.inflow_m3_s = np.zeros(len(self._holes))
        self.outflow_m3_s = np.zeros(len(self._holes))
        # Scalar times volume that has left through holes [unit m3].
        self.escaped_m3 = 0.0
        self.set_releasing(is_on=True)
        self._find_flows()

    @property
    def turnover_m_s(self) -> float:
        """Return the scale of the speeds at which what is released turns the air over, (g' Q / H)^(1/3) [m/s]."""
        released = sum(abs(r.scalar_m3_s) for r in (*self.scalar.releases, *self.scalar.surfaces))
        return elementary.cbrt(abs(self.scalar.buoyancy_m_s2) * released / self._height_m)

    @property
    def speed_m_s(self) -> float:
        """Return the scale of the largest driven speeds [m/s]: also (g' ds H)^(1/2) of values."""
        values = [self.scalar.start, 0.0, *(surface.value or 0.0 for surface in self.scalar.surfaces)]
        by_values = math.sqrt(abs(self.scalar.buoyancy_m_s2) * (max(values) - min(values)) * self._height_m)
        return max(by_values, self.turnover_m_s)

    def longest_step_s(self) -> float:
        """Return the longest time step that its accelerations and volumes allow [s]."""
        scalar, cell_m = self.scalar, self._domain.cell_m
        pull_m_s2 = abs(scalar.buoyancy_m_s2) * float(largest_step(self.values, self._domain.air))
        limits = [_STEP_SHARE * math.sqrt(cell_m / pull_m_s2)] if pull_m_s2 > 0 else []
        released = [self._emission * r.scalar_m3_s for _, r in self._releases]
        for scalar_m3_s in (*released, *(surface.scalar_m3_s for surface in self._surfaces)):
            pull_m4_s3 = abs(scalar.buoyancy_m_s2 * scalar_m3_s)
            limits += [elementary.cbrt(cell_m * cell_m * cell_m * cell_m / pull_m4_s3)] if pull_m4_s3 > 0 else []
        flows = [float(flow) for flow in (*self.outflow_m3_s, *self.inflow_m3_s)]
        flows += [plume.largest_m3_s for plume in self._plumes]
        limits += [_STEP_SHARE * cell_m * cell_m * cell_m / flow for flow in flows if flow > 0]
        return min(limits, default=math.inf)

    def set_releasing(self, *, is_on: bool) -> None:
        """Open or shut all releases; from the next step on."""
        self._next_emission = float(is_on)

    def column_mean(self) -> NDArray[np.float64]:
        """Return the mean of the scalar over the air at each height, (nz,)."""
        air = self._domain.air[_INNER]
        total = np.where(air, self.values[_INNER], 0).sum(axis=(0, 1), dtype=np.float64)
        return total / np.maximum(air.sum(axis=(0, 1)), 1)

    def advance(self, velocity: Velocity, model: TurbulenceModel, dt_s: float) -> None:
        """Move, mix and release the scalar for one step in a velocity that was projected with `source_m_s`."""
        domain, scalar = self._domain, self.scalar
        cell_m, new = domain.cell_m, self._next
        self._fill_padding(velocity)
        sigma = scalar.turbulent_schmidt
        transport_scalar(
            self.values, *velocity, model.nu, model.nu_m2_s, scalar.diffusivity_m2_s, sigma, dt_s, cell_m, new
        )
        volume_m3 = cell_m * cell_m * cell_m
        for cell, release in self._releases:
            new[cell] += np.float32(self._emission * dt_s * release.scalar_m3_s / volume_m3)
        for plume in self._plumes:
            plume.carry(self.values, new, dt_s)
        for outward, (cell, _) in zip(self.outflow_m3_s, self._holes):
            fraction = min(dt_s * outward / volume_m3, 1.0)
            new[cell] -= np.float32(fraction) * self.values[cell]
            self.escaped_m3 += fraction * volume_m3 * float(self.values[cell])
        for placed in self._surfaces:
            placed.give(self.values, new, model, scalar.diffusivity_m2_s, dt_s)
        new[~domain.air] = 0
        self.values, self._next = new, self.values
        self._find_flows()
        if isinstance(model, KEpsilon):
            stratification(self.values, model.nu, scalar.buoyancy_m_s2, cell_m, self._stratification)
            model.stratification_per_s2, model.scalar_sigma = self._stratification, sigma

    def push(self, w: F32, dt_s: float, stage_weight: float) -> None:
        """Add the buoyancy of one Runge-Kutta stage to the padded z-velocities [m/s], in place."""
        push_by_buoyancy(self.values, self._domain.coefficients[2], self.scalar.buoyancy_m_s2, dt_s, stage_weight, w)

    # Entering air is without the scalar, leaving air has the value inside.
    def _fill_padding(self, velocity: Velocity) -> None:
        for placed in self._domain.outlets:
            normal = velocity[placed.axis][placed.layer(slice(placed.face, placed.face + 1))]
            leaves = normal > 0 if placed.is_high else normal < 0
            within = self.values[placed.layer(slice(placed.inside, placed.inside + 1))]
            self.values[placed.layer(placed.outside)] = np.where(leaves, within, 0)

    # Volume that enters and leaves cells from now on: by releases, and by holes from the pressure inside.
    def _find_flows(self) -> None:
        self._emission = self._next_emission
        if not self._holes and not self.released_m3_s:
            return
        cell_m = self._domain.cell_m
        if self.source_m_s is None:
            self.source_m_s = padded(self._domain.shape)
        self.source_m_s[:] = 0
        for cell, release in self._releases:
            self.source_m_s[cell] += np.float32(self._emission * release.volume_m3_s / (cell_m * cell_m))
        for plume in self._plumes:
            plume.rise(self.values, self.scalar.buoyancy_m_s2, self._emission)
            plume.add_volume(self.source_m_s)
        if not self._holes:
            return
        column = self.column_mean()
        z_m = np.concatenate(([0.0], (np.arange(column.size) + 0.5) * cell_m))
        column = np.concatenate((column[:1], column))
        head = self.scalar.buoyancy_m_s2 * np.concatenate(
            ([0.0], np.cumsum(np.diff(z_m) * 0.5 * (column[1:] + column[:-1])))
        )
        outward = np.empty_like(self._strip_z_m)
        share = np.interp(self._strip_z_m, z_m, column)
        net_m3_s = self._emission * self.released_m3_s
        flows_through_holes(
            np.interp(self._strip_z_m, z_m, head), share, self._strip_area_m2, self.scalar.density_ratio, net_m3_s,
            outward,
        )  # fmt: skip
        strips = outward.reshape(-1, _STRIPS)
        self.outflow_m3_s = np.maximum(strips, 0).sum(axis=1)
        self.inflow_m3_s = np.maximum(-strips, 0).sum(axis=1)
        for net, (cell, _) in zip(strips.sum(axis=1), self._holes):
            self.source_m_s[cell] -= np.float32(net / (cell_m * cell_m))


def _cell_of(position_m: Vec3, domain: Domain, name: str) -> tuple[int, int, int]:
    at = np.asarray(position_m, float)
    size_m = np.asarray(domain.shape) * domain.cell_m
    if at.shape != (3,) or not ((at >= 0) & (at <= size_m + 1e-9)).all():
        raise FlowError(f"{name} at {position_m}: expected three coordinates in the box, at most {tuple(size_m)} m.")
    i, j, k = (LOW + np.minimum(np.floor(at / domain.cell_m + 1e-9).astype(int), np.asarray(domain.shape) - 1)).tolist()
    if not domain.air[i, j, k]:
        raise FlowError(f"{name} at {position_m}: lies in a solid cell; move it into the air.")
    return i, j, k


def _check_exits(domain: Domain, scalar: BuoyantScalar, released_m3_s: float) -> None:
    is_closed = not any(isinstance(p.patch, Outlet) for p in domain.placed)
    if scalar.orifices and (domain.inlets or not is_closed):
        raise FlowError("orifices: expected a box without inlet and outlet; make the larger openings outlets only.")
    if released_m3_s and is_closed and not scalar.orifices:
        raise FlowError(f"releases: {released_m3_s:.3g} m3/s cannot leave a closed box; add an Orifice or an Outlet.")
