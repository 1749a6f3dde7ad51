"""Values outside the box: what the stencils see beyond walls, inlets and outlets."""

import numpy as np

from gslcosim.flow.boundaries.domain import Domain
from gslcosim.flow.boundaries.patches import MovingWall, Open, SlipWall
from gslcosim.flow.boundaries.placement import PlacedPatch
from gslcosim.flow.boundaries.wall_friction import mirror_into_ghosts
from gslcosim.flow.pressure import F32, LOW
from gslcosim.flow.turbulence import Velocity


def impose_inlets(domain: Domain, velocity: Velocity, time_s: float) -> None:
    """Set the prescribed velocities on the faces of inlets, in place.

    Args:
        domain: The domain.
        velocity: Padded face velocities [m/s], modified.
        time_s: For inlets that change in time [s].
    """
    for placed in domain.inlets:
        _impose_inlet(placed, velocity, domain, time_s)


def impose_open_pressure(domain: Domain, velocity: Velocity, pressure: F32) -> None:
    """Set the pressure outside open patches: -u_n^2 / 2 where air enters, else 0 [m2/s2], in place.

    Args:
        domain: The domain.
        velocity: Padded face velocities [m/s].
        pressure: Padded pressure over density [m2/s2], modified outside open patches only.
    """
    for placed in domain.outlets:
        if not isinstance(placed.patch, Open):
            continue
        n = domain.shape[placed.axis]
        face, outside = (LOW + n, LOW + n) if placed.is_high else (LOW, LOW - 1)
        normal = velocity[placed.axis][placed.layer(face)]
        entering = np.minimum(normal, 0) if placed.is_high else np.maximum(normal, 0)
        pressure[placed.layer(outside)] = -0.5 * entering**2


def fill_padding(domain: Domain, velocity: Velocity, nu: F32, time_s: float) -> None:
    """Set the velocities outside the air that the stencils of the momentum equation reach, in place.

    Walls mirror the velocity along them so that it is the wall's in between, frictionless walls mirror it evenly;
    an inlet has its own; at an outlet all is as inside where air leaves, without normal velocity where it enters
    unless it is open, and the viscosity is as inside. Obstacles mirror like walls, into their outermost layer of cells.

    Args:
        domain: The domain.
        velocity: Padded face velocities [m/s], modified outside the box and inside solids only.
        nu: Padded viscosity [m2/s], modified outside outlets.
        time_s: For inlets that change in time [s].
    """
    for axis in range(3):
        for is_high in (False, True):
            _mirror_at_walls(domain, velocity, axis, is_high=is_high)
    for component, ghosts in zip(velocity, domain.ghosts):
        mirror_into_ghosts(component.ravel(), ghosts.faces, ghosts.starts, ghosts.sources)
    for placed in domain.placed:
        if isinstance(placed.patch, (SlipWall, MovingWall)):
            _mirror_at_patch(placed, velocity, domain)
    impose_inlets(domain, velocity, time_s)
    for placed in domain.outlets:
        _fill_outlet(placed, velocity, nu, domain)


def clear_ghosts(domain: Domain, velocity: Velocity) -> None:
    """Set the velocities inside obstacles back to 0, in place."""
    for component, ghosts in zip(velocity, domain.ghosts):
        component.ravel()[ghosts.faces] = 0


# Layers just inside and just outside the box at one side.
def _layers(domain: Domain, axis: int, *, is_high: bool) -> tuple[int, int]:
    return (LOW + domain.shape[axis] - 1, LOW + domain.shape[axis]) if is_high else (LOW, LOW - 1)


def _mirror_at_walls(domain: Domain, velocity: Velocity, axis: int, *, is_high: bool) -> None:
    inside, outside = _layers(domain, axis, is_high=is_high)
    beyond, within = [slice(None)] * axis + [outside], [slice(None)] * axis + [inside]
    for component in range(3):
        if component != axis:
            np.negative(velocity[component][tuple(within)], out=velocity[component][tuple(beyond)])


def _mirror_at_patch(placed: PlacedPatch, velocity: Velocity, domain: Domain) -> None:
    inside, outside = _layers(domain, placed.axis, is_high=placed.is_high)
    for component in range(3):
        if component == placed.axis:
            continue
        within = velocity[component][placed.layer(inside, face_axis=component)]
        value = within
        if isinstance(placed.patch, MovingWall):
            value = np.float32(2 * placed.patch.velocity_m_s[component]) - within
        velocity[component][placed.layer(outside, face_axis=component)] = value


# Prescribed velocities on an inlet's faces and in the padding outside of it.
def _impose_inlet(placed: PlacedPatch, velocity: Velocity, domain: Domain, time_s: float) -> None:
    assert placed.inflow is not None
    speeds = placed.inflow.at(time_s)
    n = domain.shape[placed.axis]
    inside = LOW + n - 1 if placed.is_high else LOW
    is_air = domain.air[placed.layer(slice(inside, inside + 1))]
    outside = slice(inside + 1, None) if placed.is_high else slice(0, LOW)
    normal = slice(inside + 1, None) if placed.is_high else slice(0, LOW + 1)
    for axis in range(3):
        if axis == placed.axis:
            speed = np.expand_dims(speeds[..., axis], placed.axis)
            velocity[axis][placed.layer(normal)] = np.where(is_air, speed, np.float32(0))
        else:
            speed = _between_cells(speeds[..., axis], axis - (axis > placed.axis))
            velocity[axis][placed.layer(outside, face_axis=axis)] = np.expand_dims(speed, placed.axis)


# Values of cells averaged to the faces between them along one axis; at the ends those of the cell.
def _between_cells(values: F32, axis: int) -> F32:
    first, last = np.take(values, [0], axis=axis), np.take(values, [-1], axis=axis)
    return 0.5 * (np.concatenate((first, values), axis=axis) + np.concatenate((values, last), axis=axis))


# Padding outside an outlet: velocities as inside, but where air enters no normal one unless open; viscosity as inside.
def _fill_outlet(placed: PlacedPatch, velocity: Velocity, nu: F32, domain: Domain) -> None:
    n = domain.shape[placed.axis]
    face = LOW + n if placed.is_high else LOW
    normal = velocity[placed.axis]
    leaving = normal[placed.layer(slice(face, face + 1))]
    if not isinstance(placed.patch, Open):
        leaving = np.maximum(leaving, 0) if placed.is_high else np.minimum(leaving, 0)
    inside = face - 1 if placed.is_high else face
    normal[placed.layer(slice(face + 1, None) if placed.is_high else slice(0, face))] = leaving
    outside = slice(inside + 1, None) if placed.is_high else slice(0, LOW)
    for axis in range(3):
        if axis != placed.axis:
            along = placed.layer(slice(inside, inside + 1), face_axis=axis)
            velocity[axis][placed.layer(outside, face_axis=axis)] = velocity[axis][along]
    just_outside = inside + 1 if placed.is_high else inside - 1
    nu[placed.layer(just_outside)] = nu[placed.layer(inside)]
