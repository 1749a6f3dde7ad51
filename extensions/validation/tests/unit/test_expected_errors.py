"""What the air of a run may be wrong by: its kind of air, and the finding in its validity."""

import json

import pytest
import yaml

from gslcosim.scenario import load_scenario
from gslcosim.validity.findings import assess_run, format_validity
from gslcosim_validation.air_kinds import AIR_KINDS, find_air_kind
from gslcosim_validation.expected_errors import find_expected_error, read_expected_errors

HEAT = "environment.heat=[{kind: body, position_m: [2, 2, 0.5], power_w: 500}]"
HELIUM = "wind.buoyancy={releases: [{position_m: [3, 3, 1], flow_m3_s: 0.001}]}"


def scenario(name, *overrides):
    return load_scenario(name, overrides=overrides).scenario


@pytest.mark.parametrize(
    ("name", "overrides", "kind"),
    [
        ("tiny_room", (), "open_ground"),
        ("warehouse_empty", (), "room_with_forced_wind"),
        ("gsl_bench_3", (), "room_with_forced_wind"),
        ("vision_room", ("environment.layout={kind: plant}", "wind.solver=built_in"), "open_ground"),
        ("warehouse_empty", ("environment.layout={kind: wind_tunnel}",), "room_with_forced_wind"),
        ("warehouse_empty", ("gas={model: farrell, sources: [{position_m: [3, 3, 1]}]}",), "open_ground"),
        ("warehouse_empty", ("gas={model: gaussian_plume, sources: [{position_m: [3, 3, 1]}]}",), "open_ground"),
        ("tiny_room", ("gas.model=playback", "gas.playback={folder: .}"), "room_with_forced_wind"),
        (
            "warehouse_empty",
            (HELIUM,),
            "room_with_heat",
        ),
        ("warehouse_empty", (HEAT,), "room_with_heat"),
    ],
)
def test_the_kind_of_air_is_that_of_what_drives_it(name, overrides, kind):
    assert find_air_kind(scenario(name, *overrides)) == kind


@pytest.mark.parametrize(
    ("recipe", "kind"),
    [
        ({"layout": {"kind": "office"}, "wind": {"solver": "built_in"}}, "room_with_forced_wind"),
        ({"layout": {"kind": "office"}, "wind": {"solver": "uniform"}}, "open_ground"),
        ({"layout": {"kind": "plant"}, "wind": {"solver": "built_in"}}, "open_ground"),
        ({"gsl_bench": "rooms/004", "wind": {"solver": "auto"}}, "room_with_forced_wind"),
        ({"layout": "their office", "wind": "weak"}, "room_with_forced_wind"),
        ({"layout": {"kind": "home"}, "heat": [{"name": "stove"}], "wind": {"solver": "built_in"}}, "room_with_heat"),
    ],
)
def test_an_environment_folder_has_the_air_of_its_recipe(tmp_path, recipe, kind):
    header = {"format": "gslcosim/environment/1", "boxes": [], "made_from": recipe}
    (tmp_path / "environment.yaml").write_text(yaml.safe_dump(header, sort_keys=False))
    plan = scenario("tiny_room")
    plan = plan.model_copy(update={"environment": plan.environment.model_copy(update={"path": ".", "layout": None})})
    assert find_air_kind(plan, tmp_path) == kind


def test_the_validity_of_a_run_quotes_its_kind_of_air(tmp_path):
    validity = assess_run(scenario("tiny_room"), [tmp_path], summary={}, n_ticks=10, sandboxes={})
    fields = json.loads(json.dumps(validity.as_fields()))
    found, known = fields["expected_error"], read_expected_errors()
    assert found["kind_of_air"] == "open_ground"
    assert found["mean"] == known["kinds_of_air"]["open_ground"]["mean"]
    assert found["intensity"]["low"] < found["intensity"]["ratio"] < found["intensity"]["high"]
    assert found["level"] == 0.9
    assert found["severity"] == "quote"
    assert validity.verdict == "yes"
    (line,) = [line for line in format_validity(fields) if "expected_error" in line]
    assert line.startswith(f"  quote    expected_error: Open ground: mean concentration {found['mean']['ratio']:.2g} [")


def test_each_kind_of_air_has_an_interval_and_says_whose_it_is():
    for kind in AIR_KINDS:
        known = read_expected_errors()["kinds_of_air"][kind]
        assert 0.0 <= known["mean"]["fac2"] <= 1.0
        assert all(each["low"] < each["ratio"] < each["high"] for each in known.values())
    (room,) = find_expected_error(scenario("warehouse_empty"), [])
    assert room.figures["mean"]["of_all_kinds"]
    assert "measured sets of all kinds of air" in room.text


def test_filaments_without_eddies_are_told_that_they_err_by_more():
    walk = "gas.turbulence.kind=none"
    (plain,), (eddying,) = (find_expected_error(scenario("tiny_room", *more), []) for more in ((walk,), ()))
    assert "without eddies" in plain.remedy
    assert eddying.remedy == ""
