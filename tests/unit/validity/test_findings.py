"""What speaks for or against a run's figures: severities, sentences, and keys that stay."""

import json
import re
from dataclasses import asdict
from pathlib import Path

import pytest

from gslcosim.environment.generation.provenance import find_mixed_air, read_wind_provenance
from gslcosim.scenario import load_scenario
from gslcosim.validity.conduct import AgentConduct, SensorUse, count_sensor_use, read_conduct
from gslcosim.validity.findings import Finding, assess_conduct, assess_run, format_validity

MANIFEST = {
    "gslcosim": "0.1.0", "git": "abc", "lock": {"sha256": "f" * 64, "differing": []}, "installed_sha256": "0" * 64,
}  # fmt: skip
REFEREES_KEYS = ("n_commands", "n_refused", "n_adjusted", "first_refusal", "gas_contact_s", "has_succeeded")
PAGE = Path(__file__).parents[3] / "docs/validity.md"


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    """What extensions find about runs: nothing but what a test adds."""
    found = []
    monkeypatch.setattr("gslcosim.validity.findings.load_registered", lambda *_: iter(found))
    return found


def scenario(*overrides, name="tiny_room"):
    return load_scenario(name, overrides=overrides).scenario


def conduct(**more):
    sensors = {"nose": SensorUse(n_ticks=100, n_saturated=0, n_warming_up=0)}
    return AgentConduct(**{"agent": "beetle", "n_commands": 36, "gas_contact_s": 2.0, "sensors": sensors} | more)


def findings(*agents):
    return {finding.about: finding for finding in assess_conduct(agents or (conduct(),))}


def solved(tmp_path, **settling):
    known = {"has_settled": True, "uncertainty_frac": 0.02} | settling
    (tmp_path / "wind_report.json").write_text(json.dumps({"end_time_s": 300.0, "settling": known or None}))
    return tmp_path


def assess(plan, *winds, agents=(), **more):
    """Assess a run whose agents did what the referee says of these."""
    fields = {each.agent: asdict(each) for each in agents or (conduct(),)}
    states = {name: {"nose": [(0, False, False)]} for name in fields}
    told = {name: {key: known[key] for key in REFEREES_KEYS} for name, known in fields.items()}
    summary = {"conduct": told, "sensor_states": states}
    known = {"summary": summary, "n_ticks": 100, "sandboxes": {"beetle": "bubblewrap"}, "manifest": MANIFEST}
    return assess_run(plan, winds, **known | more)


def by_about(validity):
    return {finding.about: finding for finding in validity.findings}


def test_a_run_with_a_settled_wind_in_a_sandbox_is_valid(tmp_path):
    validity = assess(scenario("wind.solver=auto"), solved(tmp_path))
    assert validity.verdict == "yes"
    assert {finding.severity for finding in validity.findings} == {"ok"}
    assert format_validity(validity.as_fields()) == ["valid      yes"]


def test_a_wind_that_has_not_settled_is_a_warning_with_a_remedy(tmp_path):
    plan = scenario("wind.solver=auto")
    wind = by_about(assess(plan, solved(tmp_path, has_settled=False, uncertainty_frac=0.19)))["wind"]
    assert wind.severity == "warning"
    assert "not settled within 300 s, its mean uncertain by at least 19%" in wind.text
    assert f"wind.max_time_s={2 * plan.wind.max_time_s:g}" in wind.remedy
    assert wind.figures == {"maker": "built_in", "name": "built_in", "settled": False, "uncertainty_frac": 0.19}


def test_of_several_winds_the_worst_counts(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    rooms = solved(tmp_path / "a"), solved(tmp_path / "b", has_settled=False)
    assert by_about(assess(scenario("wind.solver=auto"), *rooms))["wind"].severity == "warning"


def test_an_environment_folder_says_who_has_made_its_wind(tmp_path):
    plan = scenario()
    plan = plan.model_copy(update={"environment": plan.environment.model_copy(update={"path": "room", "layout": None})})
    header = "format: gslcosim/environment/1\nboxes: []\nmade_from: {gsl_bench: rooms/004, wind: {solver: %s}}\n"
    for solver, maker, name in (("auto", "imported", "rooms/004"), ("{file: w.csv}", "file", "w.csv"),
                                ("uniform", "uniform", "uniform")):  # fmt: skip
        (tmp_path / "environment.yaml").write_text(header % solver)
        found = read_wind_provenance(plan, tmp_path)
        assert (found.maker, found.name) == (maker, name)
    (tmp_path / "environment.yaml").write_text("format: gslcosim/environment/1\n")
    assert read_wind_provenance(plan, tmp_path).maker == "unknown"


@pytest.mark.parametrize(
    ("maker", "is_mixed"), [("built_in", True), ("uniform", True), ("imported", False), ("file", False)]
)
def test_stored_gas_beside_another_wind_is_found(maker, is_mixed):
    plan = scenario("gas.model=playback", "gas.playback={folder: .}")
    found = find_mixed_air(plan, maker)
    assert (found is not None) is is_mixed
    assert find_mixed_air(scenario(), maker) is None


def test_mixed_air_is_a_warning_of_the_run(tmp_path):
    plan = scenario("gas.model=playback", "gas.playback={folder: .}", "wind.solver=auto")
    gas = by_about(assess(plan, solved(tmp_path)))["gas"]
    assert gas.severity == "warning"
    assert "wind.solver: {file: PATH}" in gas.remedy


def test_refused_commands_are_counted_and_the_first_reason_is_said():
    text = "waypoint.position_world_m: expected x from 0 to 10, was 40"
    found = findings(conduct(n_refused=36, first_refusal=f"{text}."))["commands"]
    assert found.severity == "warning"
    assert f"refused 36 of 36 commands of beetle, the first because {text}." in found.text
    assert found.figures["agents"]["beetle"]["refused"] == 36


def test_a_changed_command_is_a_note():
    assert findings(conduct(n_adjusted=5, first_refusal="goes elsewhere"))["commands"].severity == "note"


def test_a_sensor_that_is_saturated_for_long_is_a_warning():
    sensors = {"nose": SensorUse(n_ticks=100, n_saturated=30, n_warming_up=5)}
    found = findings(conduct(sensors=sensors))["sensors"]
    assert (found.severity, found.figures["agents"]["beetle"]["nose"]) == (
        "warning", {"saturated_frac": 0.3, "warming_up_frac": 0.05},
    )  # fmt: skip
    assert "nose of beetle was saturated for 30.0%" in found.text


def test_success_without_gas_needed_no_olfaction():
    found = findings(conduct(gas_contact_s=None, has_succeeded=True))["contact"]
    assert found.severity == "warning"
    assert "no olfaction" in found.text
    assert findings(conduct(gas_contact_s=None))["contact"].severity == "note"


def test_states_of_sensors_count_up_to_the_end_of_the_run():
    changes = [(0, False, True), (10, False, False), (50, True, False), (90, False, False)]
    assert count_sensor_use([], n_ticks=60) == SensorUse(n_ticks=60, n_saturated=0, n_warming_up=0)
    assert count_sensor_use(changes, n_ticks=60) == SensorUse(n_ticks=60, n_saturated=10, n_warming_up=10)
    assert count_sensor_use(changes, n_ticks=100) == SensorUse(n_ticks=100, n_saturated=40, n_warming_up=10)


def test_a_run_without_its_referee_has_no_conduct():
    assert read_conduct({}, n_ticks=3) == []
    assert list(assess_conduct([])) == []


def test_a_run_that_broke_is_not_valid(tmp_path):
    assert assess(scenario("wind.solver=auto"), solved(tmp_path), is_complete=False).verdict == "no"


def test_without_a_sandbox_or_by_the_clock_is_a_note(tmp_path):
    plan = scenario("wind.solver=auto", "pace=1", "agents[0].mode=free")
    found = by_about(assess(plan, solved(tmp_path), sandboxes={"beetle": "none"}, unconfined=["beetle"]))
    assert (found["isolation"].severity, found["isolation"].figures["sandboxed"]) == ("note", False)
    assert (found["determinism"].severity, found["determinism"].figures["deterministic"]) == ("note", False)


def test_other_packages_than_the_lock_has_are_a_note(tmp_path):
    lock = {"sha256": "f" * 64, "differing": ["numpy", "scipy", "a", "b"]}
    found = by_about(assess(scenario(), solved(tmp_path), manifest=MANIFEST | {"lock": lock}))["software"]
    assert found.severity == "note"
    assert "numpy, scipy, a and 1 more" in found.text


def test_a_terminal_gets_warnings_with_remedies_and_the_names_of_notes(tmp_path):
    agents = (conduct(n_refused=9, first_refusal="why", gas_contact_s=None),)
    lines = format_validity(assess(scenario("wind.solver=auto"), solved(tmp_path), agents=agents).as_fields())
    assert lines[0] == "valid      with warnings"
    assert lines[1].startswith("  warning  commands: The vehicle refused 9 of 36")
    assert lines[2:] == ["  notes    contact (validity in result.json)"]


def test_an_extension_adds_findings_and_what_is_to_be_quoted_is_printed(tmp_path, registered):
    def find(plan, environments):
        yield Finding(about="tide", severity="quote", text=f"{plan.name}: low.", figures={"n": len(environments)})

    registered.append(find)
    fields = assess(scenario("wind.solver=auto"), solved(tmp_path)).as_fields()
    assert fields["tide"] == {"severity": "quote", "text": "tiny_room: low.", "remedy": "", "n": 1}
    assert fields["verdict"] == "yes"
    assert format_validity(fields) == ["valid      yes", "  quote    tide: tiny_room: low."]


@pytest.mark.parametrize(
    ("find", "said"),
    [(lambda *_: 1 / 0, "ZeroDivisionError"), (lambda *_: ["low tide"], "expected a Finding, was 'low tide'")],
)
def test_a_finding_that_fails_costs_a_run_nothing_else(tmp_path, registered, find, said):
    registered.append(find)
    fields = assess(scenario("wind.solver=auto"), solved(tmp_path)).as_fields()
    assert said in fields["extensions"]["text"]
    assert {"wind", "commands"} <= set(fields)


def test_the_page_has_every_key(tmp_path):
    fields = assess(scenario(), solved(tmp_path)).as_fields()
    keys = {about: set(block) - {"severity", "text", "remedy"} for about, block in fields.items() if about != "verdict"}
    rows = re.findall(r"^\| `(\w+)` \|.*?\| (.*?) \|$", PAGE.read_text(), re.MULTILINE)
    assert {about: set(re.findall(r"`(\w+)`", cell)) & keys.get(about, set()) for about, cell in rows} == keys
