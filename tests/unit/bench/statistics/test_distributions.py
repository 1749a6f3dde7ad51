import math

import pytest
from scipy import special, stats

from gslcosim.bench.statistics import estimates as ours


@pytest.mark.parametrize("a", [0.5, 1.0, 3.0, 90.0, 2000.0])
@pytest.mark.parametrize("b", [0.5, 2.0, 45.0, 5000.0])
@pytest.mark.parametrize("x", [0.0, 1e-3, 0.2, 0.5, 0.97, 1.0])
def test_incomplete_beta_agrees_with_scipy(a, b, x):
    assert ours.beta_cdf(x, a, b) == pytest.approx(special.betainc(a, b, x), rel=1e-9, abs=1e-14)


@pytest.mark.parametrize("probability", [0.01, 0.3, 0.5, 0.975, 0.9995])
@pytest.mark.parametrize("freedom", [1, 2, 9, 89, 5000])
def test_student_quantile_agrees_with_scipy(probability, freedom):
    expected = stats.t.ppf(probability, freedom)
    assert ours.student_quantile(probability, freedom) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_normal_tail_and_quantile_are_inverse():
    assert ours.normal_tail(ours.normal_quantile(0.999)) == pytest.approx(1e-3)
    assert ours.two_sided_z(0.95) == pytest.approx(1.959963984540054)
    assert ours.normal_tail(10.0) == pytest.approx(stats.norm.sf(10.0))
    assert math.isclose(ours.student_quantile(0.5, 3), 0.0)
