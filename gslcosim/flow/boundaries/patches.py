"""Patches on the boundary of the box: inlets, outlets, openings to the outdoors, other kinds of wall."""

from dataclasses import dataclass

from gslcosim.base.quantities import Vec3
from gslcosim.flow.boundaries.inflow import InletVelocity, Schedule


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A rectangle on the boundary of the box, given as a flat box: corners in the grid's frame [m].

    It acts on the boundary cells whose centre it covers. The boundary outside all patches is a wall at rest.
    """

    min_m: Vec3
    max_m: Vec3

    def __str__(self) -> str:
        """Name the patch in messages."""
        return f"{type(self).__name__}(min_m={self.min_m}, max_m={self.max_m})"


@dataclass(frozen=True, kw_only=True, eq=False)
class Inlet(Patch):
    """Air enters with a given velocity [m/s]; one that points out of the box is a fan that extracts air.

    `velocity_m_s` is one of

    - a velocity, the same on the whole patch;
    - an array (na, nb, 3) of velocities of the patch's cells, a and b the two axes along it in the order x, y, z;
    - a function from (n, 3) centres of boundary faces, grid's frame [m], to (n, 3) velocities, for example
      `parabolic_profile` or `log_profile`;
    - a `Schedule` of velocities.

    All but the last are multiplied by `factor`, a `Schedule` of numbers, where there is one.
    `turbulence_intensity` is the root mean square of the fluctuations over the mean speed, per axis;
    its default, and the length scale of 0.1 times the patch's shorter side, are AutoGDM+'s.
    """

    velocity_m_s: InletVelocity
    factor: Schedule | None = None
    turbulence_intensity: float = 0.05


@dataclass(frozen=True, kw_only=True)
class Outlet(Patch):
    """Air leaves (or enters) freely: the pressure on the patch is zero.

    What enters comes without momentum of its own, as from a still room next door.
    """


@dataclass(frozen=True, kw_only=True)
class Open(Outlet):
    """The outdoors go on: air leaves, or is drawn in, through the side or top of a box in the open.

    Where air leaves the pressure is zero. Where it enters it has sped up from far away, so the pressure is
    p = -u_n^2 / 2 (Bernoulli, p over density), and it keeps the velocity it has inside: no velocity changes across
    the patch. Wind along the patch therefore stays as it is, and a jet entrains air from the sides.

    Source: Dong, Karniadakis and Chryssostomidis 2014, doi:10.1016/j.jcp.2013.12.042, equation 3: the kinetic energy
    of what enters is taken from the pressure, which keeps the flow from feeding on its own backflow.
    Deviation: the speed normal to the patch instead of the whole speed, sharply switched: with the whole speed, wind
    along the patch would be no solution.
    """


@dataclass(frozen=True, kw_only=True)
class MovingWall(Patch):
    """A wall that drags the air with it; `velocity_m_s` must lie in the wall's plane."""

    velocity_m_s: Vec3


@dataclass(frozen=True, kw_only=True)
class SlipWall(Patch):
    """A wall without friction, or a plane of symmetry."""
