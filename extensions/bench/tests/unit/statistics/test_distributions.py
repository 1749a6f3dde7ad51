import math

import pytest
from scipy import stats

from gslcosim_bench.statistics import estimates as ours


@pytest.mark.parametrize("probability", [1e-6, 0.025, 0.5, 0.975])
@pytest.mark.parametrize("shape", [1, 7, 540])
def test_beta_quantile_of_a_shape_of_one(probability, shape):
    """I_x(a, 1) = x^a, and I_x(1, b) = 1 - (1 - x)^b."""
    assert ours.beta_quantile(probability, shape, 1) == pytest.approx(probability ** (1 / shape), rel=1e-12)
    expected = -math.expm1(math.log1p(-probability) / shape)
    assert ours.beta_quantile(probability, 1, shape) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("probability", [0.01, 0.3, 0.5, 0.975, 0.9995])
def test_student_quantile_of_few_degrees_of_freedom(probability):
    """With one it is Cauchy's distribution; with two it has a closed form as well."""
    cauchy = math.tan(math.pi * (probability - 0.5))
    assert ours.student_quantile(probability, 1) == pytest.approx(cauchy, rel=1e-11, abs=1e-12)
    two = (2 * probability - 1) / math.sqrt(2 * probability * (1 - probability))
    assert ours.student_quantile(probability, 2) == pytest.approx(two, rel=1e-11, abs=1e-12)


def test_student_quantile_tends_to_the_normal_one():
    assert ours.student_quantile(0.975, 9) == pytest.approx(2.262157163, rel=1e-9)
    assert ours.student_quantile(0.975, 10**9) == pytest.approx(ours.two_sided_z(0.95), rel=1e-8)


def test_normal_tail_and_quantile_are_inverse():
    assert ours.normal_tail(ours.normal_quantile(0.999)) == pytest.approx(1e-3)
    assert ours.two_sided_z(0.95) == pytest.approx(1.959963984540054)
    assert ours.normal_tail(10.0) == pytest.approx(stats.norm.sf(10.0))
    assert math.isclose(ours.student_quantile(0.5, 3), 0.0)
