"""Inside obstacles, beside their surface, the velocity along it is mirrored, so that it vanishes on the surface."""

import numpy as np

from gslcosim.flow import Inlet, Outlet
from gslcosim.flow.domain import build_domain
from gslcosim.flow.pressure import LOW, padded
from gslcosim.flow.solver import clear_ghosts, fill_padding

SHAPE = (9, 7, 6)


def domain_with(block):
    free = np.ones(SHAPE, bool)
    free[block] = False
    inlet = Inlet(min_m=(0, 0, 0), max_m=(0, 7, 6), velocity_m_s=(1, 0, 0))
    return build_domain(free, 1.0, [inlet, Outlet(min_m=(9, 0, 0), max_m=(9, 7, 6))])


def filled(domain):
    rng = np.random.default_rng(1)
    velocity = []
    for coefficient in domain.coefficients:
        component = rng.normal(size=coefficient.shape).astype(np.float32)
        component[coefficient == 0] = 0
        velocity.append(component)
    fill_padding(domain, tuple(velocity), padded(SHAPE), 0.0)
    return tuple(velocity)


def at(*index):
    return tuple(LOW + i for i in index)


def test_the_velocity_along_a_surface_vanishes_on_it():
    u, v, w = filled(domain_with((slice(3, 6), slice(2, 5), slice(0, 3))))
    assert u[at(4, 3, 2)] == -u[at(4, 3, 3)]  # top
    assert v[at(4, 3, 2)] == -v[at(4, 3, 3)]
    assert w[at(3, 3, 1)] == -w[at(2, 3, 1)]  # side
    assert v[at(5, 3, 1)] == -v[at(6, 3, 1)]
    assert u[at(4, 2, 1)] == -u[at(4, 1, 1)]


def test_an_edge_has_the_mean_of_its_two_surfaces():
    u, _, _ = filled(domain_with((slice(3, 6), slice(2, 5), slice(0, 3))))
    assert np.isclose(u[at(4, 2, 2)], -0.5 * (u[at(4, 2, 3)] + u[at(4, 1, 2)]))


def test_nothing_passes_the_surface_and_the_inside_stays_still():
    u, v, w = filled(domain_with((slice(2, 7), slice(1, 6), slice(0, 4))))
    assert u[at(2, 3, 1)] == u[at(7, 3, 1)] == 0
    assert v[at(4, 1, 1)] == w[at(4, 3, 4)] == 0
    assert u[at(4, 3, 1)] == v[at(4, 3, 1)] == w[at(4, 3, 2)] == 0


def test_the_box_mirrors_at_its_walls_and_ghosts_can_be_cleared():
    domain = domain_with((slice(3, 6), slice(2, 5), slice(0, 3)))
    velocity = filled(domain)
    u, _, w = velocity
    assert u[at(4, 3, 6)] == -u[at(4, 3, 5)]
    assert w[at(4, -1, 3)] == -w[at(4, 0, 3)]
    clear_ghosts(domain, velocity)
    assert u[at(4, 3, 2)] == 0
