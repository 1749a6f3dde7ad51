"""Time stepping: Heun's method with one projection per step, and values beyond walls, inlets and outlets."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import FlowError
from gslcosim.flow import momentum_kernels, pressure, turbulence
from gslcosim.flow.buoyancy import Buoyancy
from gslcosim.flow.domain import Domain, carry_past_edges
from gslcosim.flow.patches import MovingWall, Open, PlacedPatch, SlipWall
from gslcosim.flow.pressure import F32, HIGH, LOW, PressureSolver, SolveStats, padded
from gslcosim.flow.turbulence import TurbulenceModel, Velocity, mirror_into_ghosts, still_velocity

_RUNAWAY_SPEEDS = 50.0  # times the largest speed on the boundary; beyond, the solve has diverged
_VISCOUS_LIMIT = 0.07  # nu dt / h^2; Heun is stable up to 1/12 where the stress acts on a not yet projected field


def impose_inlets(domain: Domain, velocity: Velocity, time_s: float) -> None:
    """Set the prescribed velocities on the faces of inlets, in place.

    Args:
        velocity: Padded face velocities [m/s], modified.
        time_s: Time, for inlets that change [s].
    """
    for placed in domain.inlets:
        _impose_inlet(placed, velocity, domain, time_s)


def impose_open_pressure(domain: Domain, velocity: Velocity, pressure: F32) -> None:
    """Set the pressure outside open patches: -u_n^2 / 2 where air enters, else 0 [m2/s2], in place.

    Args:
        velocity: Padded face velocities [m/s].
        pressure: Padded pressure over density [m2/s2], modified outside open patches only.
    """
    for placed in domain.outlets:
        if not isinstance(placed.patch, Open):
            continue
        normal = velocity[placed.axis][placed.layer(placed.face)]
        entering = np.minimum(normal, 0) if placed.is_high else np.maximum(normal, 0)
        pressure[placed.layer(placed.just_outside)] = -0.5 * np.square(entering)


def fill_padding(domain: Domain, velocity: Velocity, nu: F32, time_s: float) -> None:
    """Set the velocities outside the air that the stencils of the momentum equation read, in place.

    Walls mirror the tangential velocity so that its mean is the wall's, frictionless walls copy it; an inlet prescribes
    its own; outside an outlet all is as inside where air leaves, without normal velocity where it enters unless it is
    open, and the viscosity is as inside. Obstacles mirror like walls, into their outermost layer of cells.

    Args:
        velocity: Padded face velocities [m/s], modified outside the box and inside solids only.
        nu: Padded viscosity [m2/s], modified outside outlets.
        time_s: Time, for inlets that change [s].
    """
    for axis in range(3):
        for is_high in (False, True):
            _mirror_at_walls(domain, velocity, axis, is_high=is_high)
    for component, ghosts in zip(velocity, domain.ghosts):
        mirror_into_ghosts(component.ravel(), ghosts.faces, ghosts.starts, ghosts.sources)
    for placed in domain.placed:
        if isinstance(placed.patch, (SlipWall, MovingWall)):
            _mirror_at_patch(placed, velocity)
    impose_inlets(domain, velocity, time_s)
    for placed in domain.outlets:
        _fill_outlet(placed, velocity, nu)


def clear_ghosts(domain: Domain, velocity: Velocity) -> None:
    """Set the velocities inside obstacles back to 0, in place."""
    for component, ghosts in zip(velocity, domain.ghosts):
        component.ravel()[ghosts.faces] = 0


def _mirror_at_walls(domain: Domain, velocity: Velocity, axis: int, *, is_high: bool) -> None:
    n = domain.shape[axis]
    inside, outside = (LOW + n - 1, LOW + n) if is_high else (LOW, LOW - 1)
    beyond, within = [slice(None)] * axis + [outside], [slice(None)] * axis + [inside]
    for component in range(3):
        if component != axis:
            np.negative(velocity[component][tuple(within)], out=velocity[component][tuple(beyond)])


def _mirror_at_patch(placed: PlacedPatch, velocity: Velocity) -> None:
    for component in range(3):
        if component == placed.axis:
            continue
        within = velocity[component][placed.layer(placed.inside, face_axis=component)]
        value = within
        if isinstance(placed.patch, MovingWall):
            value = np.float32(2 * placed.patch.velocity_m_s[component]) - within
        velocity[component][placed.layer(placed.just_outside, face_axis=component)] = value


# Prescribed velocities on an inlet's faces and in the padding outside of it.
def _impose_inlet(placed: PlacedPatch, velocity: Velocity, domain: Domain, time_s: float) -> None:
    assert placed.inflow is not None
    speeds = placed.inflow.at(time_s)
    is_air = domain.air[placed.layer(slice(placed.inside, placed.inside + 1))]
    normal = placed.outside if placed.is_high else slice(0, placed.face + 1)
    for axis in range(3):
        if axis == placed.axis:
            speed = np.expand_dims(speeds[..., axis], placed.axis)
            velocity[axis][placed.layer(normal)] = np.where(is_air, speed, np.float32(0))
        else:
            speed = _between_cells(speeds[..., axis], axis - (axis > placed.axis))
            velocity[axis][placed.layer(placed.outside, face_axis=axis)] = np.expand_dims(speed, placed.axis)


# Values of cells averaged to the faces between them along one axis; at the ends the value of the cell.
def _between_cells(values: F32, axis: int) -> F32:
    first, last = np.take(values, [0], axis=axis), np.take(values, [-1], axis=axis)
    return 0.5 * (np.concatenate((first, values), axis=axis) + np.concatenate((values, last), axis=axis))


# Padding outside an outlet: as inside, but without normal velocity where air enters, unless open.
def _fill_outlet(placed: PlacedPatch, velocity: Velocity, nu: F32) -> None:
    face, inside, normal = placed.face, placed.inside, velocity[placed.axis]
    leaving = normal[placed.layer(slice(face, face + 1))]
    if not isinstance(placed.patch, Open):
        leaving = np.maximum(leaving, 0) if placed.is_high else np.minimum(leaving, 0)
    normal[placed.layer(slice(face + 1, None) if placed.is_high else slice(0, face))] = leaving
    for axis in range(3):
        if axis != placed.axis:
            along = placed.layer(slice(inside, inside + 1), face_axis=axis)
            velocity[axis][placed.layer(placed.outside, face_axis=axis)] = velocity[axis][along]
    nu[placed.layer(placed.just_outside)] = nu[placed.layer(inside)]


@dataclass(frozen=True, kw_only=True)
class StepRecord:
    """One time step, for the history.

    Attributes:
        time_s: End of the step [s].
        dt_s: Its length [s].
        courant: Largest (|u| + |v| + |w|) dt / h of a cell.
        max_speed_m_s: Largest |u| + |v| + |w| of a cell before the step [m/s].
        max_viscosity_m2_s: Largest viscosity, molecular plus eddy, before the step [m2/s].
        kinetic_energy_m2_s2: Mean over the air of half the squared speed before the step [m2/s2].
        inflow_m3_s: Air that enters through all patches after the step [m3/s].
        outflow_m3_s: Air that leaves [m3/s].
        pressure: The pressure solve; its last residual is the largest |div u| h left in a cell.
    """

    time_s: float
    dt_s: float
    courant: float
    max_speed_m_s: float
    max_viscosity_m2_s: float
    kinetic_energy_m2_s2: float
    inflow_m3_s: float
    outflow_m3_s: float
    pressure: SolveStats


@dataclass(frozen=True, kw_only=True)
class _Survey:
    # State of the air before a step: largest speed sum and viscosity, mean kinetic energy.
    speed_m_s: float
    viscosity_m2_s: float
    energy_m2_s2: float


class FlowSolver:
    """Incompressible flow in a domain: state, and one method that advances it.

    du/dt + div(u u) = -grad p + div(2 nu S),  div u = 0            p pressure over density [m2/s2]

    Staggered grid; advection linear upwind; stress central; explicit in time (Heun) with
    the last pressure in both stages and one projection for its increment at the end.

    Source: Harlow and Welch 1965, doi:10.1063/1.1761178 (grid); van Kan 1986, doi:10.1137/0907059 (increment).
    Held by: tests/analytic/flow
    """

    def __init__(
        self,
        domain: Domain,
        model: TurbulenceModel,
        *,
        courant: float = 0.9,
        max_step_s: float = math.inf,
        tolerance: float = 1e-4,
        initial_velocity: Velocity | None = None,
        buoyancy: Buoyancy | None = None,
    ) -> None:
        """Start the flow, projected to be divergence-free.

        Args:
            model: Turbulence model of the same domain.
            courant: Largest (|u| + |v| + |w|) dt / h, at most 1.
            max_step_s: Largest time step, regardless of the Courant number [s].
            tolerance: Root mean square of div(u) h that a step may leave, over the reference speed.
            initial_velocity: Padded face velocities [m/s]; still air if absent.
            buoyancy: Gas or heat of the same domain that the wind carries and is driven by.
        """
        self.domain = domain
        self.buoyancy = buoyancy
        self.model = model
        self.courant = courant
        self.max_step_s = max_step_s
        self.time_s = 0.0
        self.n_steps = 0
        self.velocity = initial_velocity or still_velocity(domain)
        self._stage = still_velocity(domain)
        self.pressure = padded(domain.shape)
        self._projection = PressureSolver(domain.coefficients, is_closed=domain.is_closed)
        for state in (self.velocity, self._stage):
            impose_inlets(domain, state, 0.0)
        driven_m_s = max(domain.reference_speed_m_s, 0.0 if buoyancy is None else buoyancy.speed_m_s)
        speed = driven_m_s
        if initial_velocity is not None:
            speed = max(speed, *(float(np.abs(a).max()) for a in initial_velocity))
        self.reference_speed_m_s = speed or 1.0
        # Of air at rest, which could take a step of any length. The initial speeds of a flow do not limit it later:
        # those from larger cells may be many times too high where few of the cells lead to an outlet.
        self._least_speed_m_s = driven_m_s or self.reference_speed_m_s
        self._tolerance_m_s = tolerance * self.reference_speed_m_s
        self.project_tightly()

    def project_tightly(self, velocity: Velocity | None = None) -> SolveStats:
        """Remove the remaining divergence, to near the resolution of float32, from the state or given velocities."""
        return self._projection.project(
            *(velocity or self.velocity),
            tolerance_m_s=1e-5 * self.reference_speed_m_s,
            max_tolerance_m_s=1e-5 * self.reference_speed_m_s,
            max_iterations=100,
            source_m_s=self._source_m_s,
        )

    def step(self, *, until_s: float) -> StepRecord:
        """Advance by one time step that does not pass `until_s` [s].

        Raises:
            FlowError: the flow has diverged; the error names time, place and remedy.
        """
        survey = self._survey()
        dt_s = self._time_step(survey, until_s - self.time_s)
        self.model.update(self.velocity, dt_s, self._stage)
        if self.buoyancy is not None:
            self.buoyancy.advance(self.velocity, self.model, dt_s)
        is_last = until_s - self.time_s <= dt_s * (1 + 1e-9)
        end_s = until_s if is_last else self.time_s + dt_s
        # The turbulence model may have used the stage arrays as scratch: restore their padding and fixed faces.
        impose_inlets(self.domain, self._stage, self.time_s)
        self._advance(self.velocity, self.time_s, dt_s, 1.0, self._stage)
        self._advance(self._stage, end_s, dt_s, 0.5, self.velocity)
        impose_inlets(self.domain, self.velocity, end_s)
        stats = self._projection.project(*self.velocity, tolerance_m_s=self._tolerance_m_s, source_m_s=self._source_m_s)
        factor = np.float32(self.domain.cell_m / dt_s)
        pressure.accumulate_scaled(self.pressure, self._projection.x, factor)
        self.n_steps += 1
        self.time_s = end_s
        return self._record(survey, dt_s, stats)

    def centre_velocity(self, velocity: Velocity | None = None) -> F32:
        """Return the (nx, ny, nz, 3) velocity at cell centres [m/s], zero in solids."""
        out = np.empty((*self.domain.shape, 3), np.float32)
        momentum_kernels.centre_velocity(*(velocity or self.velocity), out)
        out[~self.domain.air[(slice(LOW, -HIGH),) * 3]] = 0
        return out

    def divergence_free_centre_velocity(self) -> F32:
        """Return the (nx, ny, nz, 3) velocity at cell centres [m/s] of the tightly projected state, which is kept."""
        for copy, now in zip(self._stage, self.velocity):
            np.copyto(copy, now)
        self.project_tightly(self._stage)
        return self.centre_velocity(self._stage)

    def divergence_m_s(self, velocity: Velocity | None = None) -> float:
        """Return the largest |div u| h of a cell [m/s]."""
        scratch = padded(self.domain.shape)
        _, largest = pressure.negative_divergence(*(velocity or self.velocity), *self.domain.coefficients, scratch)
        return float(largest)

    # Divergence times cell edge that remains: released volume, or flow through small holes.
    @property
    def _source_m_s(self) -> F32 | None:
        return None if self.buoyancy is None else self.buoyancy.source_m_s

    # One stage of Heun's method, including boundary values and wall friction.
    def _advance(self, start: Velocity, time_s: float, dt_s: float, weight: float, out: Velocity) -> None:
        domain, model = self.domain, self.model
        fill_padding(domain, start, model.nu, time_s)
        impose_open_pressure(domain, start, self.pressure)
        kernels = (momentum_kernels.advance_u, momentum_kernels.advance_v, momentum_kernels.advance_w)
        walls = domain.friction
        for axis, kernel in enumerate(kernels):
            kernel(
                *start, self.pressure, model.nu, domain.coefficients[axis], self.velocity[axis],
                dt_s, domain.cell_m, weight, out[axis],
            )  # fmt: skip
        if self.buoyancy is not None:
            self.buoyancy.push(out[2], dt_s, weight)
        for lip in domain.lips:
            carry_past_edges(
                start[lip.component].ravel(), start[lip.carrier].ravel(), lip.near, lip.behind, lip.through,
                lip.target, lip.away, lip.inward, dt_s, domain.cell_m, weight, out[lip.component].ravel(),
            )  # fmt: skip
        for axis in range(3):
            turbulence.apply_friction(
                start[axis].ravel(), out[axis].ravel(), walls.faces[axis], walls.owners[axis],
                walls.wall_speed_m_s[axis], model.friction_m_s, dt_s, domain.cell_m, weight,
            )  # fmt: skip

    def _record(self, survey: _Survey, dt_s: float, stats: SolveStats) -> StepRecord:
        inflow_m3_s, outflow_m3_s = mass_balance(self.domain, self.velocity)
        return StepRecord(
            time_s=self.time_s,
            dt_s=dt_s,
            courant=survey.speed_m_s * dt_s / self.domain.cell_m,
            max_speed_m_s=survey.speed_m_s,
            max_viscosity_m2_s=survey.viscosity_m2_s,
            kinetic_energy_m2_s2=survey.energy_m2_s2,
            inflow_m3_s=inflow_m3_s,
            outflow_m3_s=outflow_m3_s,
            pressure=stats,
        )

    def check(self) -> None:
        """Raise FlowError if the flow has diverged; every step begins with it."""
        self._survey()

    def _survey(self) -> _Survey:
        speed, viscosity, squares = momentum_kernels.survey_speeds(*self.velocity, self.model.nu)
        self._check_speed(float(speed))
        energy = 0.5 * float(squares) / self.domain.n_air
        return _Survey(speed_m_s=float(speed), viscosity_m2_s=float(viscosity), energy_m2_s2=energy)

    # Time step [s] by Courant number and viscosity. The last two before a stop have equal length: a very short one
    # would amplify the residual of the pressure solve.
    def _time_step(self, survey: _Survey, remaining_s: float) -> float:
        cell_m = self.domain.cell_m
        limit_s = min(self.max_step_s, self.courant * cell_m / max(survey.speed_m_s, self._least_speed_m_s))
        mixing_m2_s = survey.viscosity_m2_s
        if self.buoyancy is not None:
            mixing_m2_s = max(mixing_m2_s, self.buoyancy.scalar.diffusivity_m2_s)
            limit_s = min(limit_s, self.buoyancy.longest_step_s())
        if mixing_m2_s > 0:
            limit_s = min(limit_s, _VISCOUS_LIMIT * (cell_m * cell_m) / mixing_m2_s)
        return remaining_s / math.ceil(remaining_s / limit_s) if remaining_s < 2 * limit_s else limit_s

    def _check_speed(self, speed: float) -> None:
        if np.isfinite(speed) and speed <= _RUNAWAY_SPEEDS * self.reference_speed_m_s:
            return
        magnitude = np.abs(self.centre_velocity()).sum(axis=-1)
        worst = np.unravel_index(np.argmax(np.nan_to_num(magnitude, nan=np.inf)), magnitude.shape)
        where = ", ".join(f"{(i + 0.5) * self.domain.cell_m:.2f}" for i in worst)
        raise FlowError(
            f"the wind diverged at {self.time_s:.3f} s (step {self.n_steps}): the speed is {speed:.3g} m/s near "
            f"({where}) m, expected at most {_RUNAWAY_SPEEDS * self.reference_speed_m_s:.3g} m/s. "
            f"Use a smaller courant number (now {self.courant}), smaller cells where openings are a cell wide, "
            f"or move inlets and outlets apart."
        )


def mass_balance(domain: Domain, velocity: Velocity) -> tuple[float, float]:
    """Return the volume flow into and out of the box [m3/s], summed over boundary faces by sign."""
    flows: list[NDArray[np.float64]] = []
    for placed in (*domain.inlets, *domain.outlets):
        outward = 1.0 if placed.is_high else -1.0
        flows.append(outward * velocity[placed.axis][placed.layer(placed.face)].astype(np.float64).ravel())
    outward_flow = np.concatenate(flows) if flows else np.zeros(0)
    area = domain.cell_m * domain.cell_m
    inflow = -float(outward_flow[outward_flow < 0].sum()) * area
    return inflow, float(outward_flow[outward_flow > 0].sum()) * area
