import math

import numpy as np
import pytest
from built_gas import build_plume, build_source
from built_rooms import build_air

from gslcosim.base.errors import ModelError, ScenarioError
from gslcosim.environment.model import Cell
from gslcosim_services.fields.filament.plume import Buoyancy, filament_amount_mol, find_open_cells
from gslcosim_services.fields.filament.release import SourceShape


def test_a_filament_carries_gadens_amount_of_gas():
    """With the full pi; GADEN's simulator writes 3.14159 and gets 1.3e-6 less."""
    assert filament_amount_mol(10.0, 0.1) == pytest.approx(6.440745139e-06, rel=1e-9)
    assert filament_amount_mol(10.0, 0.1) == pytest.approx(6.440736978853164e-06, rel=1.5e-6)


def test_wind_frames_change_with_the_plumes_time():
    environment = build_air(wind_m_s=((0.5, 0.0, 0.0), (0.0, 0.5, 0.0)), period_s=1.0)
    plume = build_plume(environment, (build_source((1.0, 1.0, 1.0), rate=1.0),), diffusivity_m2_s=0.0)
    plume.advance(25)
    oldest = plume.filaments.position_world_m[0]
    assert oldest == pytest.approx((1.0 + 0.25, 1.0 + 0.5, 1.0), abs=1e-6)


def test_a_second_source_does_not_change_the_first_ones_filaments():
    first, second = build_source((1.0, 1.0, 1.0)), build_source((3.0, 2.0, 2.0), rate=5.0)
    alone, both = build_plume(sources=(first,)), build_plume(sources=(first, second))
    for plume in (alone, both):
        plume.advance(50)
    is_first = both.filaments.source_index == 0
    np.testing.assert_array_equal(both.filaments.position_world_m[is_first], alone.filaments.position_world_m)


def test_sources_with_buoyancies_of_two_powers_are_refused():
    sources = tuple(build_source(buoyancy=Buoyancy(coefficient=1e-3, power=power)) for power in (1, 3))
    with pytest.raises(ModelError, match="one power of the size"):
        build_plume(sources=sources)


def test_filaments_are_born_all_over_the_shape_but_not_behind_walls():
    cells = np.zeros((20, 16, 12), np.uint8)
    cells[10] = Cell.SOLID
    source = build_source((2.0, 2.0, 1.5), rate=2000.0, shape=SourceShape(kind="box", size_m=(2.0, 1.0, 0.4)))
    plume = build_plume(build_air(cells), (source,), step_s=0.5, diffusivity_m2_s=0.0)
    plume.advance(1)
    places = plume.filaments.position_world_m
    assert places.min(0) == pytest.approx((1.0, 1.5, 1.3), abs=0.01)
    assert places.max(0) == pytest.approx((2.5, 2.5, 1.7), abs=0.01)
    assert (places[:, 0] > 2.4999).mean() == pytest.approx(0.25, abs=0.05)


def test_places_of_birth_do_not_depend_on_the_step():
    source = build_source(rate=37.0, shape=SourceShape(kind="sphere", size_m=(1.0, 1.0, 1.0)))
    coarse, fine = (build_plume(sources=(source,), step_s=dt, diffusivity_m2_s=0.0) for dt in (0.5, 0.1))
    coarse.advance(4)
    fine.advance(20)
    np.testing.assert_array_equal(coarse.filaments.position_world_m, fine.filaments.position_world_m)


def test_open_cells_have_free_neighbours_only():
    cells = np.zeros((7, 5, 4), np.uint8)
    cells[5, 2, 2] = Cell.SOLID
    expected = np.zeros((7, 5, 4), np.uint8)
    expected[1:4, 1:4, 1:3] = 1
    np.testing.assert_array_equal(find_open_cells(cells), expected)


@pytest.mark.parametrize(
    ("place", "found"), [((2.6, 2.0, 1.0), "inside a solid"), ((2.0, 9.0, 1.0), "outside the room")]
)
def test_a_source_outside_the_air_is_refused(place, found):
    cells = np.zeros((20, 16, 12), np.uint8)
    cells[10] = Cell.SOLID
    with pytest.raises(ScenarioError, match=rf"gas\.sources\[1\]\.position_m: .*{found}"):
        build_plume(build_air(cells), (build_source(), build_source(place)))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_wind_that_is_not_finite_stops_the_plume(bad, axis):
    environment = build_air()
    environment.wind.velocity_m_s[..., axis] = bad
    plume = build_plume(environment)
    with pytest.raises(ModelError, match="not finite in gas step 1"):
        plume.advance(2)


def test_wind_of_another_shape_is_refused():
    environment = build_air()
    environment.wind.__dict__["velocity_m_s"] = np.zeros((1, 3, 3, 3, 3), np.float32)
    with pytest.raises(ModelError, match=r"expected wind frames of shape \(t, 20, 16, 12, 3\)"):
        build_plume(environment)


def test_a_birth_at_the_end_of_a_step_has_no_negative_age():
    """The time of birth over this step's length rounds up to more than the number of steps."""
    step_s = 0.3617837949641972
    plume = build_plume(sources=(build_source(rate=40.0 / step_s),), step_s=step_s, diffusivity_m2_s=0.5)
    plume.advance(3)
    assert plume.filaments.sigma_m[-1] == pytest.approx(0.1)
