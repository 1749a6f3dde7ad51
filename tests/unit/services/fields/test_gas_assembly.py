import dataclasses
import math

import numpy as np
import pytest
from pydantic import ValidationError

from gslcosim.base.errors import ScenarioError
from gslcosim.scenario.models.gas import ReleaseSpec, ShapeSpec
from gslcosim_services.fields.models.filament_gas import build_gas_model

PLACE = (5.0, 5.0, 2.0)


@pytest.fixture
def gas_of(make_scenario, make_room):
    """Build the gas of a scenario with these sources and settings."""

    def build(*sources, tick_ms=100, **gas):
        gas = {"sources": [{"position_m": PLACE, **source} for source in sources or ({},)], **gas}
        return build_gas_model(make_scenario(tick_ms=tick_ms, gas=gas), make_room())

    return build


def displacement_std_m(model, n_steps=1):
    model.plume.advance(1)
    before = model.plume.filaments.position_world_m.copy()
    model.plume.advance(n_steps)
    return (model.plume.filaments.position_world_m[: len(before)] - before).std()


BURST = {"filaments_per_s": 20000.0}


def test_by_default_a_steps_noise_is_that_of_the_diffusivity(gas_of):
    for step_s in (0.1, 0.02):
        model = gas_of(BURST, step_s=step_s, eddy_diffusivity_m2_s=0.01)
        assert displacement_std_m(model) == pytest.approx(math.sqrt(2 * 0.01 * step_s), rel=0.05)


@pytest.mark.parametrize(("compatibility", "stds_m"), [("gaden_2", (0.02, 0.02)), ("gaden_3", (0.02, 0.004))])
def test_gadens_noise_depends_on_the_step_as_theirs_does(gas_of, compatibility, stds_m):
    for step_s, std_m in zip((0.1, 0.02), stds_m, strict=True):
        model = gas_of(BURST, step_s=step_s, compatibility=compatibility)
        assert displacement_std_m(model) == pytest.approx(std_m, rel=0.05)


def test_gaden_3_reads_up_to_3_sigma(gas_of):
    assert [gas_of(compatibility=c).cutoff_sigma for c in ("none", "gaden_2", "gaden_3")] == [5.0, 5.0, 3.0]


@pytest.mark.parametrize(
    ("settings", "rise_m"),
    [
        ({}, 0.0047),
        ({"buoyancy": "none"}, 0.0),
        ({"compatibility": "gaden_2"}, 0.0),
        ({"compatibility": "gaden_3"}, 0.1541),
    ],
)
def test_methane_rises_by_the_chosen_law(gas_of, settings, rise_m):
    noise = "gaden_noise_std_m" if "compatibility" in settings else "eddy_diffusivity_m2_s"
    quiet = {"growth_m2_s": 0.0, noise: 0.0}
    model = gas_of({"filaments_per_s": 1.0}, gas="methane", **quiet, **settings)
    model.plume.advance(20)
    assert model.plume.filaments.position_world_m[0, 2] == pytest.approx(2.0 + rise_m, abs=1e-4)


def test_the_gas_that_is_searched_for_comes_first(gas_of):
    assert gas_of({"gas": "methane"}, gas="acetone").gases == ("acetone", "methane")


def test_a_release_of_each_kind_can_be_asked_for(gas_of):
    kinds = [
        {"kind": "constant"},
        {"kind": "poisson"},
        {"kind": "variable", "interval_s": 0.5},
        {"kind": "intermittent", "on_s": 1.0, "off_s": 3.0},
        {"kind": "scheduled", "schedule": [[0, 10], [2, 0]]},
    ]
    born = []
    for release in kinds:
        model = gas_of({"release": release})
        model.plume.advance(40)
        born.append(model.plume.n_born)
    assert born[0] == 40
    assert 15 < born[1] < 70
    assert 5 < born[2] < 38
    assert born[3:] == [10, 20]


def test_poisson_releases_of_two_sources_differ(gas_of):
    model = gas_of({"release": {"kind": "poisson"}}, {"release": {"kind": "poisson"}})
    model.plume.advance(50)
    first, second = (model.plume.filaments.sigma_m[model.plume.filaments.source_index == i] for i in (0, 1))
    assert set(first.tolist()).isdisjoint(second.tolist())


def test_an_extended_source_fills_its_shape(gas_of):
    model = gas_of({**BURST, "shape": {"kind": "cylinder", "size_m": (2.0, 2.0, 0.5)}}, eddy_diffusivity_m2_s=0.0)
    model.plume.advance(1)
    assert np.ptp(model.plume.filaments.position_world_m, axis=0) == pytest.approx((2.0, 2.0, 0.5), abs=0.1)


@pytest.mark.parametrize(
    ("spec", "values", "expected"),
    [
        (ReleaseSpec, {"kind": "scheduled"}, "ascending times"),
        (ReleaseSpec, {"schedule": ((0.0, 1.0),)}, "schedule belongs to kind: scheduled"),
        (ReleaseSpec, {"kind": "scheduled", "schedule": ((2.0, 1.0), (1.0, 2.0))}, "ascending times"),
        (ShapeSpec, {"kind": "point", "size_m": (1.0, 0.0, 0.0)}, "no size_m with kind: point"),
        (ShapeSpec, {"kind": "line"}, "a vector that is not zero"),
        (ShapeSpec, {"kind": "sphere", "size_m": (1.0, -1.0, 1.0)}, "none negative"),
        (ShapeSpec, {"kind": "box"}, "none negative"),
    ],
)
def test_what_does_not_fit_the_kind_of_a_release_or_a_shape_is_refused(spec, values, expected):
    with pytest.raises(ValidationError, match=expected):
        spec.model_validate(values)


def test_turbulence_is_that_of_the_given_intensity_or_of_the_wind(make_scenario, make_room):
    room = make_room(wind_m_s=((0.5, 0.0, 0.0),))

    def air_of(room, **turbulence):
        gas = {"sources": [{"position_m": PLACE}], "turbulence": turbulence}
        return build_gas_model(make_scenario(gas=gas), room).air

    given = air_of(room, intensity_frac=0.2, length_m=0.5)
    assert given.velocity_std_m_s == pytest.approx(0.1)
    assert given.scales.length_m == pytest.approx(0.5)
    with pytest.raises(ScenarioError, match="the wind has no k and epsilon"):
        air_of(room, kind="wind")
    k_epsilon = np.full((*room.grid.shape, 2), (0.06, 0.01), np.float32)
    solved = dataclasses.replace(room, wind=dataclasses.replace(room.wind, k_epsilon=k_epsilon))
    assert air_of(solved, kind="wind").velocity_std_m_s == pytest.approx(0.2)
    with pytest.raises(ScenarioError, match="was still air"):
        air_of(make_room())


def test_turbulence_replaces_growth_and_random_walk(make_scenario):
    for useless in ("growth_m2_s", "eddy_diffusivity_m2_s"):
        gas = {"sources": [{"position_m": PLACE}], "turbulence": {}, useless: 0.01}
        with pytest.raises(ValidationError, match=useless):
            make_scenario(gas=gas)
