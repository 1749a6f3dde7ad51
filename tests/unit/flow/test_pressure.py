"""The pressure solver: symmetric and contracting V-cycle, divergence-free fields on any grid size."""

import numpy as np
import pytest

from gslcosim.flow import Inlet, Outlet
from gslcosim.flow.domain import build_domain
from gslcosim.flow.pressure import HIGH, LOW, PressureSolver, negative_divergence, padded, scalar_product

INNER = (slice(LOW, -HIGH),) * 3


def domain_of(shape, *, cell_m=0.5, solid=()):
    free = np.ones(shape, bool)
    for block in solid:
        free[block] = False
    x_m, y_m, z_m = (n * cell_m for n in shape)
    inlet = Inlet(min_m=(0, 0, 0), max_m=(0, y_m / 2, z_m), velocity_m_s=(1, 0, 0))
    return build_domain(free, cell_m, [inlet, Outlet(min_m=(x_m, y_m / 2, 0), max_m=(x_m, y_m, z_m))])


def random_faces(domain, seed):
    rng = np.random.default_rng(seed)
    faces = []
    for coefficient in domain.coefficients:
        face = rng.normal(size=coefficient.shape).astype(np.float32)
        face[coefficient == 0] = 0
        faces.append(face)
    return faces


def random_cells(domain, seed):
    values = padded(domain.shape)
    values[INNER] = np.random.default_rng(seed).normal(size=domain.shape) * domain.air[INNER]
    return values


def preconditioned(solver, right_hand_side):
    solver.levels[0].b[:] = right_hand_side
    solver._precondition()
    return solver.levels[0].x.copy()


@pytest.mark.parametrize("shape", [(16, 8, 8), (13, 9, 7), (5, 17, 3), (1, 6, 11)])
def test_a_projection_removes_the_divergence_on_any_grid_size(shape):
    domain = domain_of(shape)
    solver = PressureSolver(domain.coefficients, is_closed=False)
    faces = random_faces(domain, 1)
    stats = solver.project(*faces, tolerance_m_s=1e-5)
    _, largest = negative_divergence(*faces, *domain.coefficients, padded(shape))
    assert stats.first_max_m_s > 0.1
    assert largest < 1e-4
    assert stats.iterations < 20


def test_the_v_cycle_is_symmetric_so_that_conjugate_gradients_apply():
    domain = domain_of((13, 9, 7), solid=[(slice(4, 7), slice(0, 5), slice(0, 4))])
    solver = PressureSolver(domain.coefficients, is_closed=False)
    a, b = random_cells(domain, 2), random_cells(domain, 3)
    a_mb = scalar_product(a, preconditioned(solver, b))
    b_ma = scalar_product(b, preconditioned(solver, a))
    a_ma = scalar_product(a, preconditioned(solver, a))
    assert a_ma > 0
    assert a_mb == pytest.approx(b_ma, abs=1e-5 * a_ma)


def test_a_linear_solenoidal_field_has_no_divergence():
    shape = (6, 5, 4)
    u, v, w = padded(shape), padded(shape), padded(shape)
    index = np.arange(u.shape[0])[:, None, None] - LOW
    u += 2.0 * index
    v += -3.0 * (np.arange(u.shape[1])[None, :, None] - LOW)
    w += 1.0 * (np.arange(u.shape[2])[None, None, :] - LOW)
    total, largest = negative_divergence(u, v, w, np.ones_like(u), np.ones_like(u), np.ones_like(u), padded(shape))
    assert total == 0
    assert largest == 0


def test_iterations_hardly_grow_with_the_grid():
    counts = []
    for shape in ((16, 16, 8), (48, 48, 24)):
        domain = domain_of(shape)
        solver = PressureSolver(domain.coefficients, is_closed=False)
        counts.append(solver.project(*random_faces(domain, 5), tolerance_m_s=1e-4).iterations)
    assert counts[1] <= counts[0] + 5
