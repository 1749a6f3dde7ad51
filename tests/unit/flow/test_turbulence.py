"""Turbulence: strain of linear fields, transport of scalars, decay of unforced turbulence, and wall functions."""

import numpy as np
import pytest

from gslcosim.base.errors import FlowError
from gslcosim.flow import Inlet, Outlet, turbulence
from gslcosim.flow.domain import build_domain
from gslcosim.flow.pressure import HIGH, LOW, padded
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import KEpsilon, make_model

SHAPE = (9, 7, 5)
CELL_M = 0.2
NU_M2_S = 1.5e-5
INNER = (slice(LOW, -HIGH),) * 3
GRADIENT = np.array([[0.3, -0.5, 0.2], [0.7, -0.1, 0.4], [-0.6, 0.8, -0.2]])  # du_i / dx_j [1/s]


def room(*, inlet_m_s=1.0, has_obstacle=False):
    x_m, y_m, z_m = (n * CELL_M for n in SHAPE)
    inlet = Inlet(min_m=(0, 0, 0), max_m=(0, 0.6, z_m), velocity_m_s=(inlet_m_s, 0, 0))
    free = np.ones(SHAPE, bool)
    free[3:5, 2:5, :3] = not has_obstacle
    return build_domain(free, CELL_M, [inlet, Outlet(min_m=(x_m, 0, 0), max_m=(x_m, y_m, z_m))])


def linear_faces():
    faces = []
    for component in range(3):
        x = [np.arange(n + LOW + HIGH) - LOW + 0.5 for n in SHAPE]
        x[component] = x[component] - 0.5
        grid = np.meshgrid(*(CELL_M * a for a in x), indexing="ij")
        faces.append(sum(GRADIENT[component, j] * grid[j] for j in range(3)).astype(np.float32))
    return faces


def test_the_strain_of_a_linear_field_is_exact():
    strain = 0.5 * (GRADIENT + GRADIENT.T)
    out = padded(SHAPE)
    turbulence.strain_squared(*linear_faces(), CELL_M, out)
    assert out[INNER] == pytest.approx(2 * np.sum(strain**2), rel=1e-4)


def solved_faces():
    domain = room()
    solver = FlowSolver(domain, make_model("laminar", domain, NU_M2_S))
    while solver.time_s < 0.5:
        solver.step(until_s=0.5)
    solver.project_tightly()
    return domain, solver.velocity


def test_transport_keeps_a_constant_and_makes_no_new_extremes():
    domain, faces = solved_faces()
    nu = np.where(domain.air, np.float32(0.01), np.float32(0))
    constant = np.full_like(nu, 3.0)
    moved = np.zeros_like(nu)
    turbulence.transport_scalar(constant, *faces, nu, NU_M2_S, NU_M2_S, 1.0, 0.05, CELL_M, moved)
    assert moved[INNER] == pytest.approx(3.0, abs=1e-4)
    scalar = np.random.default_rng(3).random(nu.shape).astype(np.float32)
    turbulence.transport_scalar(scalar, *faces, nu, NU_M2_S, NU_M2_S, 1.0, 0.05, CELL_M, moved)
    assert moved[INNER].min() >= -1e-4
    assert moved[INNER].max() <= 1 + 1e-4


def test_diffusion_alone_keeps_the_total():
    domain = room()
    nu = np.where(domain.air, np.float32(0.05), np.float32(0))
    scalar = np.random.default_rng(4).random(nu.shape).astype(np.float32)
    moved = np.zeros_like(nu)
    still = [padded(SHAPE) for _ in range(3)]
    turbulence.transport_scalar(scalar, *still, nu, NU_M2_S, NU_M2_S, 1.3, 0.05, CELL_M, moved)
    assert moved[INNER].sum() == pytest.approx(scalar[INNER].sum(), rel=1e-5)
    assert moved[INNER].std() < scalar[INNER].std()


def test_unforced_turbulence_decays_by_the_power_law():
    """Without shear k falls as (1 + (C_2 - 1) t e0 / k0)^(-1 / (C_2 - 1)), the model's closed form."""
    shape = (3, 3, 3)
    k0, e0, dt_s, n_steps = 0.04, 0.02, 0.01, 400
    k, e, nu = (np.full_like(padded(shape), value) for value in (k0, e0, 1.0))
    production = padded(shape)
    for _ in range(n_steps):
        k_new, e_new = k.copy(), e.copy()
        turbulence.react_k_epsilon(k, e, k_new, e_new, production, nu, dt_s, np.float32(1.44), np.float32(1.92))
        k, e = k_new, e_new
    power = 1.92 - 1
    expected = k0 * (1 + power * n_steps * dt_s * e0 / k0) ** (-1 / power)
    assert k[INNER] == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("start", [2.0, 8.0])
def test_the_renormalised_model_finds_the_strain_of_homogeneous_shear(start):
    """Under constant shear S k / epsilon tends to 4.38, where the strain sink changes its sign (Yakhot et al. 1992)."""
    constants, shear_per_s, dt_s = turbulence.RENORMALISED, 1.0, 0.01
    k, nu = (np.full_like(padded((3, 3, 3)), 1.0) for _ in range(2))
    e = k * np.float32(shear_per_s / start)
    for _ in range(1200):
        production = (constants.c_mu * k**2 / e * shear_per_s**2).astype(np.float32)
        k_new, e_new = k.copy(), e.copy()
        turbulence.strain_sink_rng(k, e, production, nu, constants.c_mu, dt_s, e_new)
        turbulence.react_k_epsilon(
            k, e, k_new, e_new, production, nu, dt_s, np.float32(constants.c_1), np.float32(constants.c_2)
        )
        k, e = k_new, e_new
    assert shear_per_s * k[INNER] / e[INNER] == pytest.approx(4.38, abs=0.05)


def test_an_inlet_may_say_how_large_its_eddies_are():
    def epsilon_of(**options):
        inlet = Inlet(min_m=(0, 0, 0), max_m=(0, 0.6, 1), velocity_m_s=(1, 0, 0), **options)
        domain = build_domain(np.ones(SHAPE, bool), CELL_M, [inlet, Outlet(min_m=(1.8, 0, 0), max_m=(1.8, 1.4, 1))])
        return turbulence.inlet_turbulence(domain.inlets[0], domain)[1]

    assert epsilon_of(turbulence_length_m=0.03) == pytest.approx(2 * epsilon_of())
    with pytest.raises(FlowError, match="turbulence_length_m: expected a length above 0 m, was 0"):
        epsilon_of(turbulence_length_m=0.0)


def test_wall_friction_in_equilibrium_is_that_of_the_log_law():
    """In a layer with k = u*^2 / C_mu^(1/2) and U = u* / kappa ln(E y+) the stress is u*^2."""
    star = 0.05
    k = np.full(1, star**2 / turbulence.C_MU**0.5, np.float32)
    friction = np.zeros(1)
    turbulence.log_law_friction(np.zeros(1, np.int64), k, NU_M2_S, CELL_M, friction)
    y_plus = star * CELL_M / 2 / NU_M2_S
    speed = star / turbulence.VON_KARMAN * np.log(turbulence.WALL_ROUGHNESS_E * y_plus)
    assert friction[0] * speed == pytest.approx(star**2, rel=1e-5)


def test_wall_functions_meet_the_laminar_layer_at_its_edge():
    star = turbulence.LAMINAR_SUBLAYER * NU_M2_S / (CELL_M / 2)
    frictions = []
    for factor in (0.999, 1.001):
        k = np.full(1, (factor * star) ** 2 / turbulence.C_MU**0.5, np.float32)
        friction = np.zeros(1)
        turbulence.log_law_friction(np.zeros(1, np.int64), k, NU_M2_S, CELL_M, friction)
        frictions.append(friction[0])
    assert frictions[0] == pytest.approx(NU_M2_S / (CELL_M / 2))
    assert frictions[1] == pytest.approx(frictions[0], rel=5e-3)


def test_wall_friction_of_the_power_law_is_close_to_the_log_law():
    star = 0.05
    y_plus = star * CELL_M / 2 / NU_M2_S
    speed = star / turbulence.VON_KARMAN * np.log(turbulence.WALL_ROUGHNESS_E * y_plus)
    faces = np.full(64, speed, np.float32)
    still = np.zeros(64, np.float32)
    friction = np.zeros(1)
    turbulence.power_law_friction(
        np.full(1, 10), np.zeros((1, 3), np.float32), faces, still, still, 16, 4, NU_M2_S, CELL_M, friction
    )
    assert friction[0] * speed == pytest.approx(star**2, rel=0.1)


def test_the_room_starts_with_the_turbulence_of_its_inlet():
    model = KEpsilon(room(inlet_m_s=2.0), NU_M2_S)
    k = 1.5 * (0.05 * 2.0) ** 2
    epsilon = 0.09**0.75 * k**1.5 / (0.1 * 3 * CELL_M)
    middle = (LOW + 4, LOW + 3, LOW + 2)
    assert model.k[middle] == pytest.approx(k, rel=1e-5)
    assert model.epsilon[middle] == pytest.approx(epsilon, rel=1e-5)
    assert model.nu[middle] == pytest.approx(NU_M2_S + 0.09 * k**2 / epsilon, rel=1e-4)


def test_eddy_viscosity_and_energy_stay_positive_in_air_and_zero_viscosity_in_solids():
    domain = room(has_obstacle=True)
    solid = ~domain.air[INNER]
    assert solid.any()
    for name in ("k_epsilon", "smagorinsky"):
        solver = FlowSolver(domain, make_model(name, domain, NU_M2_S))
        while solver.time_s < 2.0:
            solver.step(until_s=2.0)
        assert np.all(solver.model.nu[domain.air] >= np.float32(NU_M2_S))
        assert not np.any(solver.model.nu[INNER][solid])
        assert not np.any(solver.velocity[1][:, LOW, :])


def test_an_unknown_model_is_refused():
    with pytest.raises(ValueError, match="k_epsilon, rng_k_epsilon, smagorinsky, laminar"):
        make_model("les", room(), NU_M2_S)
