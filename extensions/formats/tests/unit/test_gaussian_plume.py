import numpy as np
import pytest

from gslcosim.base.errors import ModelError
from gslcosim_formats.gaussian_plume import GaussianPlume, spreads_m

RELEASE_M3_S = 2e-3


def plume(**more):
    return GaussianPlume(
        **{
            "position_world_m": (10.0, -5.0, 20.0),
            "release_m3_s": RELEASE_M3_S,
            "wind_world_m_s": (3.0, 0.0, 0.0),
            **more,
        }
    )


@pytest.mark.parametrize("stability", ["A", "B", "C", "D", "E", "F"])
@pytest.mark.parametrize("x_m", [30.0, 300.0, 2000.0])
def test_the_same_gas_flows_through_every_cross_section(stability, x_m):
    """The integral of u C over y and z >= 0 is Q, ground included."""
    sy, sz = (float(s) for s in spreads_m(np.array(x_m), stability))
    y, z = np.linspace(-6 * sy, 6 * sy, 241), np.linspace(0.0, 20.0 + 7 * sz, 1201)
    grid = np.stack(np.meshgrid(10.0 + x_m, y - 5.0, z, indexing="ij"), -1).reshape(-1, 3)
    ppm = plume(stability=stability).mixing_ratio_ppm_at(grid).reshape(len(y), len(z))
    flow_m3_s = 3.0 * np.trapezoid(np.trapezoid(ppm, z, axis=1), y) * 1e-6
    assert flow_m3_s == pytest.approx(RELEASE_M3_S, rel=1e-3)


def test_on_the_axis_without_ground_it_is_the_thesiss_formula():
    sy, sz = spreads_m(np.array([100.0]), "C")
    found = plume(stability="C", has_ground=False).mixing_ratio_ppm_at(np.array([[110.0, -5.0, 20.0]]))
    np.testing.assert_allclose(found, 1e6 * RELEASE_M3_S / (2 * np.pi * sy * sz * 3.0))


def test_spreads_are_briggss_in_open_country():
    sy, sz = spreads_m(np.array([1000.0]), "D")
    assert (sy[0], sz[0]) == (pytest.approx(76.28, rel=1e-3), pytest.approx(37.95, rel=1e-3))
    by_class = [float(spreads_m(np.array(1000.0), s)[1]) for s in "ABCDEF"]
    assert by_class == sorted(by_class, reverse=True)


def test_turning_the_wind_turns_the_plume():
    offset, turned_offset = np.array([40.0, 6.0, -3.0]), np.array([-6.0, 40.0, -3.0])
    straight = plume().mixing_ratio_ppm_at(np.array([[10.0, -5.0, 20.0]]) + offset)
    turned = plume(wind_world_m_s=(0.0, 3.0, 0.0)).mixing_ratio_ppm_at(np.array([[10.0, -5.0, 20.0]]) + turned_offset)
    assert straight[0] > 0
    np.testing.assert_allclose(turned, straight)


def test_upwind_there_is_no_gas():
    assert plume().mixing_ratio_ppm_at(np.array([[9.0, -5.0, 20.0], [10.0, -5.0, 20.0]])).tolist() == [0.0, 0.0]


def test_calm_air_is_refused():
    with pytest.raises(ModelError, match="was calm air"):
        plume(wind_world_m_s=(0.0, 0.0, 1.0)).mixing_ratio_ppm_at(np.zeros((1, 3)))
