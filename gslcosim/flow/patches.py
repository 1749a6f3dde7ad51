"""What can happen on the boundary of the box: inlets, outlets, moving and frictionless walls."""

from dataclasses import dataclass

from gslcosim.environment.grid import Vec3


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A rectangle on the boundary of the box, given as a flat box: corners in the grid's frame [m].

    It acts on the boundary cells whose centre it covers. The boundary outside all patches is a wall at rest.
    """

    min_m: Vec3
    max_m: Vec3


@dataclass(frozen=True, kw_only=True)
class Inlet(Patch):
    """Air enters (or leaves) with a fixed velocity [m/s].

    `turbulence_intensity` is the root mean square of the fluctuations over the mean speed, per axis;
    its default, and the length scale of 0.1 times the patch's shorter side, are AutoGDM+'s.
    """

    velocity_m_s: Vec3
    turbulence_intensity: float = 0.05


@dataclass(frozen=True, kw_only=True)
class Outlet(Patch):
    """Air leaves (or enters) freely: the pressure on the patch is zero."""


@dataclass(frozen=True, kw_only=True)
class MovingWall(Patch):
    """A wall that drags the air with it; `velocity_m_s` must lie in the wall's plane."""

    velocity_m_s: Vec3


@dataclass(frozen=True, kw_only=True)
class SlipWall(Patch):
    """A wall without friction, or a plane of symmetry."""
