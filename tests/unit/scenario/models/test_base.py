"""A key that belongs to some kinds of a block only is refused with the others, even at its default, and not dumped."""

import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.serialization import dump_resolved, plain_values


@pytest.mark.parametrize(
    ("override", "path", "home"),
    [
        ("gas.plume={}", "gas.plume", "plume belongs to model: gaussian_plume, meandering_plume."),
        ("gas.farrell.n_nodes=5", "gas.farrell", "farrell belongs to model: farrell."),
        ("gas.gaden_noise_std_m=0.02", "gas.gaden_noise_std_m", "belongs to compatibility: gaden_2, gaden_3."),
        ("gas.sources[0].release.on_s=10", "gas.sources[0].release.on_s", "on_s belongs to kind: intermittent."),
        ("gas.sources[0].shape.size_m=[0, 0, 0]", "gas.sources[0].shape.size_m", "belongs to kind: box, line, "),
        ("wind.turbulence=k_epsilon", "wind.turbulence", "turbulence belongs to solver: auto, built_in, openfoam."),
        ("wind.loops=true", "wind.loops", "loops belongs to solver: auto, built_in, stored, file."),
    ],
)
def test_a_key_of_another_kind_is_refused_and_its_home_named(override, path, home):
    with pytest.raises(ScenarioError) as refusal:
        load_scenario("tiny_room", overrides=[override])
    assert str(refusal.value).startswith((f"--set: {path}: expected no ", f"--set: {path}: expected one of the keys "))
    assert home in str(refusal.value)


@pytest.mark.parametrize(
    ("gas", "path"),
    [
        ("{model: gaussian_plume, plume: {meander_s: 20}}", "gas.plume.meander_s"),
        ("{model: gaussian_plume, growth_m2_s: 0.001}", "gas.growth_m2_s"),
        ("{compatibility: gaden_2, buoyancy: none}", "gas.buoyancy"),
    ],
)
def test_keys_inside_a_block_and_beside_a_mode_are_refused_too(gas, path):
    sources = "sources: [{position_m: [1.5, 2, 1]}]}"
    with pytest.raises(ScenarioError, match=f"--set: {path}: expected (no|one of the keys) "):
        load_scenario("tiny_room", overrides=[f"gas={gas[:-1]}, {sources}"])


@pytest.mark.parametrize("kind", ["constant", "poisson", "variable", "intermittent"])
@pytest.mark.parametrize("model", ["filament", "gaussian_plume", "meandering_plume", "farrell"])
def test_what_is_dumped_holds_no_useless_key_and_loads_back_equal(model, kind, tmp_path):
    overrides = [f"gas.model={model}", f"gas.sources[0].release.kind={kind}"]
    loaded = load_scenario("tiny_room", overrides=overrides)
    file = tmp_path / "scenario.yaml"
    file.write_text(dump_resolved(loaded.scenario))
    again = load_scenario(file).scenario
    assert plain_values(again) == plain_values(loaded.scenario)
    assert ("plume" in plain_values(again)["gas"]) == model.endswith("plume")
