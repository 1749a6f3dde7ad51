"""A participant that fails ahead of the run cuts nothing of what comes before, wherever it is hosted."""

import pytest
import yaml
from fan_units import build_fan
from real_runs import ROOT, TINY_ROOM, fly, fly_here
from test_participants import FAULT, with_program

LONG = ("--set", "referee.stop.time_limit_s=4", "--set", "referee.success.within_m=0.01")
EXAMPLE = ROOT / "docs" / "examples" / "fmi" / "ventilated_room.yaml"
# What a program does at tick 17, and the last tick that all others have then. It is asked ahead of the others: nobody
# reads what it writes.
# An answer that is refused, and a process that ends, stand for the others among many processes.
EVERYWHERE = ("exits", "garbage", "fmi3DoStep:error", "fmi3DoStep:segfault")
PROGRAM_FAULTS = ("exits", "is_killed", "garbage", "wrong_tick", "nan", "closes", "other_output")
UNIT_FAULTS = {
    "fmi3DoStep:end": (3, "fmi3DoStep: expected a step to 1.7 s, the unit asked to end the simulation."),
    "fmi3DoStep:error": (3, "fmi3DoStep: expected status OK or Warning at 1.7 s, was Error. It logged: "),
    "fmi3DoStep:early": (3, "fmi3DoStep: expected a step to 1.7 s, it returned early at 1.65 s."),
    "fmi2DoStep:discard": (2, "fmi2DoStep: expected a step at 1.7 s, was Discard; it got to 0.05 s."),
    "fmi2DoStep:fatal": (2, "fmi2DoStep: expected status OK or Warning at 1.7 s, was Fatal."),
    "fmi2DoStep:error": (2, "fmi2DoStep: expected status OK or Warning at 1.7 s, was Error."),
    "fmi3DoStep:segfault": (3, "expected the outputs of tick 17 from fmi3DoStep, but its process was killed by"),
}  # fmt: skip


def fly_for(fault, scenario, folder, *words):
    """Fly in one process, and for a fault of `EVERYWHERE` in many, too."""
    here = fly_here(scenario, folder / "here", *words)
    if fault not in EVERYWHERE:
        return [here]
    return [
        here,
        fly(scenario, folder / "grouped", "--processes", "grouped", *words),
        fly(scenario, folder / "separate", "--processes", "separate", *words),
    ]


def assert_equal_faults(runs, name, *, tick=16):
    """Assert that all runs end at one tick with one fault, and return its text."""
    for run in runs:
        assert run.exit_code == FAULT, run.errors
        (fault,) = run.result["faults"]
        assert (fault["participant"], fault["tick"], run.result["ticks"]) == (name, tick, tick)
        assert run.result["end_reason"] == "simulation_fault"
        assert run.result["digest"] is None
    (text,) = {run.result["faults"][0]["text"].partition(" The end of its log:")[0] for run in runs}
    return text


@pytest.mark.slow
@pytest.mark.parametrize("fault", PROGRAM_FAULTS)
def test_a_program_that_fails_at_a_tick_leaves_all_ticks_before_it(tmp_path, fault):
    block = with_program(fault, 17, period_s=0.1)
    assert_equal_faults(fly_for(fault, TINY_ROOM, tmp_path, *block, *LONG), "model")


@pytest.fixture
def room(tmp_path):
    """Return the scenario with one fan, which fails from 1.6 s on: in its step to tick 17."""

    def build(version, fault):
        scenario = yaml.safe_load(EXAMPLE.read_text())
        fan = scenario["participants"][0]
        fan["start"] = {"fmu": build_fan(tmp_path, version).name}
        fan["outputs"]["state"] = {"is_on": "is_in_gas", "n_steps": "n_steps"}
        fan["environment"] = {"UNIT_FAULT": fault, "UNIT_FAULT_S": "1.6"}
        path = tmp_path / "room.yaml"
        path.write_text(yaml.safe_dump({**scenario, "participants": [fan], "snapshots": None}))
        return path

    return build


@pytest.mark.slow
@pytest.mark.extras
@pytest.mark.parametrize("fault", UNIT_FAULTS)
def test_a_unit_that_fails_at_a_tick_leaves_all_ticks_before_it(tmp_path, room, fault):
    version, text = UNIT_FAULTS[fault]
    words = ("--set", "referee.success.within_m=0.01")
    assert assert_equal_faults(fly_for(fault, room(version, fault), tmp_path, *words), "fan").startswith(text)


@pytest.mark.slow
def test_a_fault_beyond_the_verdict_is_none(tmp_path):
    """A program is asked for ticks that the run does not have, before the verdict is there."""
    right = fly_here(TINY_ROOM, tmp_path / "right", *with_program("right", 17), "--set", "referee.stop.time_limit_s=1")
    words = (*with_program("exits", 17), "--set", "referee.stop.time_limit_s=1")
    for run in fly_for("exits", TINY_ROOM, tmp_path, *words):
        assert run.result["faults"] == [], run.errors
        assert run.result["ticks"] == 10
        assert run.result["digest"] == right.result["digest"] is not None
