"""Natural convection in a heated cavity against de Vahl Davis 1983, doi:10.1002/fld.1650030305, table VI."""

import pytest

from gslcosim_validation.cases.heated_cavity import solve_heated_cavity

NUSSELT = {1e3: 1.118, 1e4: 2.243, 1e5: 4.519, 1e6: 8.800}
W_MAX = {1e3: 3.697, 1e4: 19.617, 1e5: 68.59, 1e6: 219.36}


def check(rayleigh, n_cells, turnovers):
    flow = solve_heated_cavity(rayleigh, n_cells, turnovers)
    assert flow.nusselt_hot == pytest.approx(NUSSELT[rayleigh], rel=0.02)
    assert flow.nusselt_cold == pytest.approx(flow.nusselt_hot, rel=1e-3)
    assert flow.w_max == pytest.approx(W_MAX[rayleigh], rel=0.02)
    # Air above is warmer than air below, and the flow is the same when the cavity is turned by half a turn.
    assert flow.warmth[:, -1].mean() > flow.warmth[:, 0].mean()
    assert flow.warmth[::-1, ::-1] == pytest.approx(-flow.warmth, abs=1e-3)


def test_a_cavity_that_hardly_convects():
    check(1e3, 16, 15.0)


@pytest.mark.slow
@pytest.mark.parametrize(("rayleigh", "n_cells", "turnovers"), [(1e4, 32, 40.0), (1e5, 48, 40.0), (1e6, 96, 60.0)])
def test_a_cavity_whose_walls_have_layers(rayleigh, n_cells, turnovers):
    check(rayleigh, n_cells, turnovers)
