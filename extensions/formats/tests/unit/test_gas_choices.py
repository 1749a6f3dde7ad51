"""Every gas model behind the one interface: built from a scenario, repeatable, and independent of its step."""

import numpy as np
import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim.base.gases import air_density_mol_m3
from gslcosim.contract.participant import Episode
from gslcosim.scenario.models.gas import SourceSpec
from gslcosim_formats.gaussian_plume import GaussianPlume
from gslcosim_services.fields.core import FieldsCore
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_services.fields.gas_field import PointGrid
from gslcosim_services.fields.gas_setup import mean_release_m3_s

SOURCE_M = (2.0, 5.0, 2.0)
POINTS = np.array([(4.0, 5.0, 2.0), (6.0, 5.2, 2.1), (1.0, 5.0, 2.0)])
WINDY = ("gaussian_plume", "meandering_plume", "farrell", "filament")


@pytest.fixture
def field_of(make_scenario, make_room):
    """Build the gas of a scenario in a room with wind along x."""

    def build(model, *, wind_m_s=(0.5, 0.0, 0.0), seed=3, sources=({},), **gas):
        gas = {"model": model, "sources": [{"position_m": SOURCE_M, **s} for s in sources], **gas}
        return build_gas_field(make_scenario(seed=seed, gas=gas), make_room(wind_m_s=(wind_m_s,)))

    return build


def gusts(model, std_m_s):
    return {"farrell": {"gust_std_m_s": std_m_s}} if model == "farrell" else {}


def neutral(model):
    return {} if model.endswith("plume") else {"buoyancy": "none"}


def after(field, time_s, step_s=0.1):
    field.advance(round(time_s / step_s))
    return field.mixing_ratio_ppm_at(POINTS)[:, 0]


@pytest.mark.parametrize("model", WINDY)
def test_a_reset_repeats_the_gas_and_another_seed_changes_what_has_chance(field_of, model):
    field = field_of(model, **gusts(model, 0.05))
    first = after(field, 20.0)
    assert first.max() > 0.0
    field.reset(3)
    np.testing.assert_array_equal(after(field, 20.0), first)
    field.reset(4)
    assert (after(field, 20.0) != first).any() == (model != "gaussian_plume")


@pytest.mark.parametrize("model", ["gaussian_plume", "meandering_plume"])
def test_a_formula_does_not_know_the_step(field_of, model):
    coarse, fine = (after(field_of(model, step_s=step_s), 30.0, step_s) for step_s in (0.5, 0.05))
    np.testing.assert_allclose(fine, coarse, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["filament", "farrell"])
def test_spread_in_the_wind_does_not_depend_on_the_step(field_of, model):
    burst = {"filaments_per_s": 400.0}
    clouds = []
    for step_s in (0.2, 0.05):
        field = field_of(model, sources=(burst,), step_s=step_s)
        field.advance(round(8.0 / step_s))
        clouds.append(field.filaments.position_world_m)
    coarse, fine = clouds
    np.testing.assert_allclose(fine.mean(axis=0), coarse.mean(axis=0), atol=0.05)
    np.testing.assert_allclose(fine.std(axis=0), coarse.std(axis=0), rtol=0.06)


def test_the_gaussian_plume_is_the_formula_with_the_sources_release_and_the_rooms_wind(field_of):
    field = field_of("gaussian_plume", plume={"stability": "B"})
    formula = GaussianPlume(
        position_world_m=SOURCE_M,
        release_m3_s=mean_release_m3_s(SourceSpec(position_m=SOURCE_M)),
        wind_world_m_s=(0.5, 0.0, 0.0),
        stability="B",
    )
    np.testing.assert_allclose(field.mixing_ratio_ppm_at(POINTS)[:, 0], formula.mixing_ratio_ppm_at(POINTS), rtol=1e-6)


def test_ten_filaments_of_ten_ppm_release_some_cubic_centimetres_a_second():
    """6.440745e-6 mol in each, at 40.8946 mol/m3 of air; half of it at a variable rate."""
    steady = SourceSpec(position_m=SOURCE_M)
    assert mean_release_m3_s(steady) == pytest.approx(10 * 6.440745139e-06 / air_density_mol_m3(), rel=1e-9)
    variable = SourceSpec.model_validate({"position_m": SOURCE_M, "release": {"kind": "variable"}})
    assert mean_release_m3_s(variable) == pytest.approx(0.5 * mean_release_m3_s(steady))
    pulsed = SourceSpec.model_validate(
        {"position_m": SOURCE_M, "release": {"kind": "intermittent", "on_s": 1, "off_s": 3}}
    )
    assert mean_release_m3_s(pulsed) == pytest.approx(0.25 * mean_release_m3_s(steady))


def test_a_schedule_has_no_steady_plume(field_of):
    source = {"release": {"kind": "scheduled", "schedule": [(0, 10)]}}
    with pytest.raises(ScenarioError, match=r"gas\.sources\[0\]\.release: expected a release that goes on for ever"):
        field_of("gaussian_plume", sources=(source,))


@pytest.mark.parametrize("model", ["gaussian_plume", "meandering_plume"])
def test_calm_air_has_no_plume_unless_a_wind_is_given(field_of, model):
    with pytest.raises(ScenarioError, match="expected a horizontal wind, was calm air"):
        field_of(model, wind_m_s=(0.0, 0.0, 0.1))
    field = field_of(model, wind_m_s=(0.0, 0.0, 0.1), plume={"wind_m_s": (0.4, 0.0, 0.0)})
    assert after(field, 30.0)[0] >= 0.0


@pytest.mark.parametrize("model", WINDY)
def test_plumes_of_several_sources_add_up_and_gases_keep_apart(field_of, model):
    other = {"position_m": (3.0, 5.1, 2.0)}
    one, two = (after(field_of(model, sources=s), 15.0) for s in (({},), (other,)))
    both = after(field_of(model, sources=({}, {**other, "gas": "acetone"}), **neutral(model)), 15.0)
    assert both.shape == one.shape
    field = field_of(model, sources=({}, {**other, "gas": "acetone"}), **neutral(model))
    field.advance(150)
    assert field.gases == ("ethanol", "acetone")
    columns = field.mixing_ratio_ppm_at(POINTS)
    np.testing.assert_allclose(columns[:, 0], both, rtol=1e-12)
    if model == "gaussian_plume":
        np.testing.assert_allclose(columns, np.stack([one, two], axis=1), rtol=1e-6)


@pytest.mark.parametrize("model", WINDY)
def test_grids_are_the_values_at_their_points(field_of, model):
    field = field_of(model)
    field.advance(100)
    grid = PointGrid(first_m=(2.1, 4.0, 1.0), spacing_m=0.5, shape=(6, 5, 4))
    volume = field.mixing_ratio_ppm_on_grid(grid, cutoff_sigma=5.0)
    assert volume.max() > 0.0
    points = field.mixing_ratio_ppm_at(grid.points_m())[:, 0].reshape(grid.shape)
    np.testing.assert_allclose(volume, points, rtol=1e-9)


def test_only_the_open_field_has_a_wind_of_its_own(field_of):
    for model in WINDY:
        field = field_of(model, **gusts(model, 0.0))
        field.advance(10)
        wind = field.wind_m_s_at(POINTS)
        if model == "farrell":
            np.testing.assert_allclose(wind, [(0.5, 0.0, 0.0)] * 3, atol=1e-6)
        else:
            assert wind is None


def test_a_core_samples_the_wind_of_the_open_field(make_scenario, make_room):
    gas = {
        "model": "farrell", "sources": [{"position_m": SOURCE_M}], "warm_up_s": 5.0,
        "farrell": {"wind_m_s": (0.7, 0.1, 0.0), "gust_std_m_s": 0.0},
    }  # fmt: skip
    core = FieldsCore(make_scenario(gas=gas), make_room())
    core.reset(Episode(seed=1))
    np.testing.assert_allclose(core._wind_at(POINTS, 0), [(0.7, 0.1, 0.0)] * 3, atol=1e-6)


def test_a_gas_of_ones_own_rises_by_its_density(field_of):
    light = {"name": "steam", "specific_gravity": 0.6}
    field = field_of("filament", gas="steam", define=[light], eddy_diffusivity_m2_s=0.0)
    field.advance(100)
    assert field.gases == ("steam",)
    assert field.filaments.position_world_m[0, 2] > 2.005


def test_the_seed_of_the_gas_replaces_that_of_the_run(make_scenario, make_room):
    def places(run_seed, **gas):
        gas = {"sources": [{"position_m": SOURCE_M}], "warm_up_s": 5.0, **gas}
        core = FieldsCore(make_scenario(gas=gas), make_room())
        core.reset(Episode(seed=run_seed))
        return core.gas.filaments.position_world_m

    np.testing.assert_array_equal(places(1, seed=9), places(2, seed=9))
    assert (places(1) != places(2)).any()
