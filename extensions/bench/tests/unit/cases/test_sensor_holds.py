"""`hold_s` of a suite: one hold after each leg for all entries, as a number or by how quickly sensors respond."""

from pathlib import Path

import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim_bench.cases import Plan, build_plan, load_suite
from gslcosim_bench.cases.sensor_holds import derive_hold_s

HEAD = "schema: gslcosim/suite/1\nname: mine\nanchors: [random_walker]\nscenarios: [tiny_room]\n"
ENTRIES = """\
entries:
  - {name: walk, start: {python: persistent_walk}, sensors: by_method}
  - {name: surge, start: {python: surge_cast}, sensors: by_method}
  - {name: beetle, start: {python: dung_beetle}, sensors: by_method}
"""


def planned(folder: Path, text: str) -> Plan:
    (folder / "suite.yaml").write_text(HEAD + text + ENTRIES)
    return build_plan(load_suite(folder / "suite.yaml"))


def holds(plan: Plan) -> dict[str, tuple[str | None, float]]:
    vehicles = {trial.entry: trial.resolved.agents[0].vehicle for trial in plan.trials}
    return {entry: (vehicle.hold_rule, vehicle.hold_s) for entry, vehicle in vehicles.items()}


def test_a_number_is_the_hold_of_all_entries_and_anchors(tmp_path: Path) -> None:
    found = holds(planned(tmp_path, "hold_s: 1.5\n"))
    assert found == dict.fromkeys(("walk", "surge", "beetle", "random_walker"), ("fixed", 1.5))


def test_by_sensor_it_is_the_response_time_of_the_sensors_on_board(tmp_path: Path) -> None:
    """A PID has a T90 of 3 s; a TGS2600 rises with 4.8 s, 11.05 s to nine tenths."""
    found = holds(planned(tmp_path, "hold_s: by_sensor\n"))
    assert {rule for rule, _ in found.values()} == {"fixed"}
    assert found["walk"][1] == found["surge"][1] == 3.0
    assert found["beetle"][1] == 11.1


def test_cases_with_other_holds_are_other_cases(tmp_path: Path) -> None:
    hashes = {planned(tmp_path, text).suite_hash for text in ("", "hold_s: 1\n", "hold_s: 2\n", "hold_s: by_sensor\n")}
    assert len(hashes) == 4


@pytest.mark.parametrize(
    ("sensor", "hold_s"),
    [
        ({"model": "pid", "delay_s": 0.25}, 3.3),
        ({"model": "pid_ideal"}, 0.0),
        ({"model": "tgs2600_ideal"}, 11.1),
        ({"model": "averaging", "averaging_s": 2.0}, 1.8),
        ({"model": "second_order", "response_s": [1.0, 2.0]}, 7.0),
        ({"model": "anemometer"}, 0.0),
    ],
)
def test_the_hold_is_nine_tenths_of_a_step_in_tenths_of_a_second(sensor: dict[str, object], hold_s: float) -> None:
    assert derive_hold_s([{"name": "nose", **sensor}, {"model": "anemometer", "name": "wind"}]) == hold_s


@pytest.mark.parametrize(
    "where", ["set: {'agents[0].vehicle.hold_s': 1}", "vary: [{'agents[0].vehicle.hold_s': [1, 2]}]"]
)
def test_it_is_said_in_one_place(tmp_path: Path, where: str) -> None:
    with pytest.raises(ScenarioError, match="hold_s"):
        planned(tmp_path, f"hold_s: 2\n{where}\n")
