"""Observed order and extrapolation: exact for values that converge with a power of the cell."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gslcosim_formats.mesh_study import compute_convergence


@given(
    order=st.floats(0.5, 3.0),
    finest_m=st.floats(0.01, 0.2),
    ratios=st.tuples(st.floats(1.3, 2.0), st.floats(1.3, 2.0)),
    limit=st.floats(0.5, 2.0),
    slope=st.floats(0.1, 1.0),
)
def test_values_with_an_error_of_a_power_of_the_cell_give_that_order_and_limit(order, finest_m, ratios, limit, slope):
    cells_m = (finest_m, finest_m * ratios[0], finest_m * ratios[0] * ratios[1])
    found = compute_convergence(cells_m, [limit + slope * (cell_m / cells_m[2]) ** order for cell_m in cells_m])
    assert found.kind == "monotone"
    assert found.order == pytest.approx(order, rel=1e-3)
    assert found.extrapolated == pytest.approx(limit, rel=1e-3)


def test_the_finest_three_meshes_count_in_any_order():
    cells_m, values = (0.1, 0.8, 0.2, 0.4), (1.01, 99.0, 1.04, 1.16)
    found = compute_convergence(cells_m, values)
    assert found.order == pytest.approx(2.0)
    assert found.extrapolated == pytest.approx(1.0)
    assert found.uncertainty_frac == pytest.approx(1.25 * 0.03 / 1.01 / 3.0)


def test_values_that_jump_about_are_said_to_oscillate():
    assert compute_convergence((0.1, 0.2, 0.4), (1.0, 1.1, 0.7)).kind == "oscillating"


@pytest.mark.parametrize("values", [(1.0, 1.0, 1.0), (1.0, 1.2, 1.3), (1.0, 1.5, 1.5)])
def test_values_that_do_not_come_closer_have_no_order(values):
    found = compute_convergence((0.1, 0.2, 0.4), values)
    assert (found.kind, found.order, found.extrapolated) == ("none", None, None)


def test_two_meshes_say_nothing():
    assert compute_convergence((0.1, 0.2), (1.0, 2.0)).kind == "none"
