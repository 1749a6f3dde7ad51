"""Turbulence models: what eddy viscosity and wall friction the momentum equation sees."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gslcosim.flow import turbulence_kernels as kernels
from gslcosim.flow.pressure import F32, padded
from gslcosim.flow.pressure_kernels import HIGH, LOW
from gslcosim.flow.walls import wall_kernels
from gslcosim.flow.walls.domain import Domain
from gslcosim.flow.walls.patches import Inlet
from gslcosim.flow.walls.placement import PlacedPatch

Velocity = tuple[F32, F32, F32]

SMAGORINSKY_CONSTANT = 0.12  # 0.1 to 0.2 in the literature, chosen here


class TurbulenceModel(Protocol):
    """Sets eddy viscosity and wall friction from the flow."""

    nu: F32
    friction_m_s: NDArray[np.float64]

    def update(self, velocity: Velocity, dt_s: float, scratch: Velocity) -> None:
        """Advance the model by a time step in the given face velocities; `scratch` may be overwritten."""
        ...


# Padded molecular viscosity in air, zero elsewhere.
def _molecular(domain: Domain, nu_m2_s: float) -> F32:
    return np.where(domain.air, np.float32(nu_m2_s), np.float32(0))


class Laminar:
    """No turbulence: constant viscosity [m2/s], friction of a laminar layer at walls."""

    def __init__(self, domain: Domain, nu_m2_s: float) -> None:
        self.nu = _molecular(domain, nu_m2_s)
        self.friction_m_s = np.zeros(domain.friction.cells.size)
        wall_kernels.viscous_friction(self.friction_m_s, nu_m2_s, domain.cell_m)

    def update(self, velocity: Velocity, dt_s: float, scratch: Velocity) -> None:
        """Do nothing."""


class Smagorinsky:
    """Large-eddy simulation: eddy viscosity from the resolved strain, power-law friction at walls.

    The wind it gives is unsteady; average it over time for a steady one.
    """

    def __init__(self, domain: Domain, nu_m2_s: float, *, constant: float = SMAGORINSKY_CONSTANT) -> None:
        """Start from still air."""
        self._domain = domain
        self._nu_m2_s = nu_m2_s
        self._constant = constant
        self.nu = _molecular(domain, nu_m2_s)
        self.friction_m_s = np.zeros(domain.friction.cells.size)

    def update(self, velocity: Velocity, dt_s: float, scratch: Velocity) -> None:
        """Recompute eddy viscosity and friction."""
        cell_m, walls = self._domain.cell_m, self._domain.friction
        u, v, w = velocity
        kernels.strain_squared(*velocity, cell_m, scratch[0])
        kernels.eddy_viscosity_smagorinsky(scratch[0], self._constant, self._nu_m2_s, cell_m, self.nu)
        _, ny, nz = self.nu.shape
        wall_kernels.power_law_friction(
            walls.cells, walls.velocity_m_s, u.ravel(), v.ravel(), w.ravel(), ny * nz, nz,
            self._nu_m2_s, cell_m, self.friction_m_s,
        )  # fmt: skip


class KEpsilon:
    """The standard k-epsilon model with wall functions in k: what pimpleFoam's `kEpsilon` computes.

    The room starts with the turbulence of the inlet, as AutoGDM+ sets it: k = 1.5 (I U)^2,
    epsilon = C_mu^(3/4) k^(3/2) / L with L = 0.1 times the inlet's shorter side.
    """

    def __init__(self, domain: Domain, nu_m2_s: float) -> None:
        self._domain = domain
        self._nu_m2_s = nu_m2_s
        self.nu = _molecular(domain, nu_m2_s)
        self.friction_m_s = np.zeros(domain.friction.cells.size)
        k, epsilon = start_turbulence(domain)
        self.k = np.full_like(self.nu, k)
        self.epsilon = np.full_like(self.nu, epsilon)
        for placed in domain.inlets:
            inlet_k, inlet_epsilon = inlet_turbulence(placed, domain)
            outside = slice(-HIGH, None) if placed.is_high else slice(0, LOW)
            self.k[placed.layer(outside)] = inlet_k
            self.epsilon[placed.layer(outside)] = inlet_epsilon
        self._take_over(self.k.copy(), self.epsilon.copy())

    def update(self, velocity: Velocity, dt_s: float, scratch: Velocity) -> None:
        """Advance k and epsilon by one explicit step, then the eddy viscosity and the wall friction."""
        cell_m, walls = self._domain.cell_m, self._domain.friction
        production, k_new, e_new = scratch
        u, v, w = velocity
        _, ny, nz = self.nu.shape
        self._fill_outlets()
        kernels.strain_squared(*velocity, cell_m, production)
        kernels.production_from_strain(self.nu, self._nu_m2_s, production)
        wall_kernels.wall_production(
            walls.cells, walls.velocity_m_s, u.ravel(), v.ravel(), w.ravel(), ny * nz, nz, self.k.ravel(),
            self._nu_m2_s, self.friction_m_s, cell_m, production.ravel(),
        )  # fmt: skip
        for scalar, sigma, moved in (
            (self.k, kernels.SIGMA_K, k_new),
            (self.epsilon, kernels.SIGMA_EPSILON, e_new),
        ):
            kernels.transport_scalar(scalar, *velocity, self.nu, self._nu_m2_s, sigma, dt_s, cell_m, moved)
        kernels.react_k_epsilon(self.k, self.epsilon, k_new, e_new, production, self.nu, dt_s)
        self._take_over(k_new, e_new)

    def set_turbulence(self, k_m2_s2: F32, epsilon_m2_s3: F32) -> None:
        """Go on from padded k and epsilon; both arrays are the model's from now on."""
        self._take_over(k_m2_s2, epsilon_m2_s3)

    # Make the new k and epsilon current, with the walls' values, and derive viscosity and friction.
    def _take_over(self, k_new: F32, e_new: F32) -> None:
        cells, cell_m, nu = self._domain.friction.cells, self._domain.cell_m, self._nu_m2_s
        wall_kernels.wall_dissipation(cells, k_new.ravel(), nu, cell_m, e_new.ravel())
        kernels.eddy_viscosity_k_epsilon(k_new, e_new, nu, self.nu, self.k, self.epsilon)
        wall_kernels.log_law_friction(cells, self.k.ravel(), nu, cell_m, self.friction_m_s)

    # Outside an outlet k and epsilon are those inside.
    def _fill_outlets(self) -> None:
        for placed in self._domain.outlets:
            n = self._domain.shape[placed.axis]
            inside = LOW + n - 1 if placed.is_high else LOW
            outside = slice(inside + 1, None) if placed.is_high else slice(0, LOW)
            for scalar in (self.k, self.epsilon):
                value = scalar[placed.layer(slice(inside, inside + 1))]
                scalar[placed.layer(outside)] = value


def start_turbulence(domain: Domain) -> tuple[float, float]:
    """Return k [m2/s2] and epsilon [m2/s3] of the air at the start: those of the most turbulent inlet."""
    return max((inlet_turbulence(placed, domain) for placed in domain.inlets), default=(1e-4, 1e-5))


def inlet_turbulence(placed: PlacedPatch, domain: Domain) -> tuple[float, float]:
    """Return k [m2/s2] and epsilon [m2/s3] of the air that an inlet brings."""
    inlet = placed.patch
    assert isinstance(inlet, Inlet)
    assert placed.inflow is not None
    speed = placed.inflow.typical_speed_m_s
    sides = [(row.stop - row.start) * domain.cell_m for row in placed.rows]
    length = 0.1 * min(sides)
    k = max(1.5 * (inlet.turbulence_intensity * speed) ** 2, 1e-8)
    return k, kernels.C_MU**0.75 * k**1.5 / length


def make_model(name: str, domain: Domain, nu_m2_s: float) -> TurbulenceModel:
    """Return the turbulence model of that name: k_epsilon, smagorinsky or laminar."""
    models = {"k_epsilon": KEpsilon, "smagorinsky": Smagorinsky, "laminar": Laminar}
    if name not in models:
        raise ValueError(f"turbulence: expected one of {', '.join(models)}, was {name!r}.")
    return models[name](domain, nu_m2_s)


def still_velocity(domain: Domain) -> Velocity:
    """Return zero face velocities for a domain."""
    return padded(domain.shape), padded(domain.shape), padded(domain.shape)
