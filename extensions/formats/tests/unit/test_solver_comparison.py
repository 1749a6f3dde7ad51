"""What the figures of a comparison mean, on winds whose likeness is known."""

import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_formats.solver_comparison import SolverComparison, compare_winds

SHAPE = (5, 4, 3)


@pytest.fixture
def wind_m_s():
    return np.random.default_rng(0).normal(size=(*SHAPE, 3)).astype(np.float32)


@pytest.fixture
def free():
    free = np.ones(SHAPE, bool)
    free[2, :, 0] = False
    return free


def test_a_weaker_wind_is_correlated_and_differs_by_what_it_lacks(wind_m_s, free):
    agreement = compare_winds(0.75 * wind_m_s, wind_m_s, free)
    for row in (agreement, *agreement.components, agreement.speed):
        assert row.correlation == pytest.approx(1)
        assert row.rms_relative == pytest.approx(0.25)
        assert row.rms_a == pytest.approx(0.75 * row.rms_b)


def test_a_component_that_turns_shows_in_its_row_only(wind_m_s, free):
    turned = wind_m_s * np.array([1, -1, 1], np.float32)
    agreement = compare_winds(turned, wind_m_s, free)
    assert [row.correlation for row in agreement.components] == pytest.approx([1, -1, 1])
    assert agreement.speed.correlation == pytest.approx(1)


def test_solids_do_not_count(wind_m_s, free):
    other = np.where(free[..., None], wind_m_s, 100)
    assert compare_winds(other, wind_m_s, free).rms_relative == 0


def test_bias_is_first_minus_second(wind_m_s, free):
    agreement = compare_winds(wind_m_s + np.array([0.5, 0, 0], np.float32), wind_m_s, free)
    assert [row.bias for row in agreement.components] == pytest.approx([0.5, 0, 0], abs=1e-6)


def test_still_air_has_no_correlation(free):
    still = np.zeros((*SHAPE, 3))
    agreement = compare_winds(still, still, free)
    assert np.isnan(agreement.correlation)
    assert np.isnan(agreement.rms_relative)


def test_winds_of_other_rooms_are_refused(wind_m_s, free):
    with pytest.raises(ShapeError, match=r"b_m_s: expected shape \(5, 4, 3, 3\).*was \(4, 4, 3, 3\)"):
        compare_winds(wind_m_s, wind_m_s[1:], free)


def test_the_text_has_both_times_and_a_row_for_each_figure(wind_m_s, free):
    comparison = SolverComparison(
        built_in_m_s=0.75 * wind_m_s,
        openfoam_m_s=wind_m_s,
        built_in_wall_s=2.0,
        openfoam_wall_s=25.0,
        n_ranks=2,
        agreement=compare_winds(0.75 * wind_m_s, wind_m_s, free),
    )
    first, _, *rows = comparison.text.splitlines()
    assert first == "built-in solver: 2.0 s; pimpleFoam: 25.0 s with 2 ranks; 12.5 times as long"
    assert [row.split()[:3] for row in rows] == [[name, "1.0000", "0.2500"] for name in ("wind", *"uvw", "speed")]
