"""Trainings: the same seed makes the same policy to the bit, interrupted or not; bad input is reported at once."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from gslcosim.base.bundled import bundled_families, bundled_train_files
from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.cli.main import main
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim_search.learned.policy_agent import POLICY_FILE
from gslcosim_search.learned.policy_files import PARAMETERS_FILE, load_parameters, load_policy
from gslcosim_training.train_file import load_train_file
from gslcosim_training.training_run import CHECKPOINT, Training

TINY = "open_halls_tiny"


def train_file(folder, **changes):
    text = bundled_train_files()[TINY].read_text()
    for before, after in changes.values():
        assert before in text
        text = text.replace(before, after)
    path = folder / "mine.yaml"
    path.write_text(text)
    return load_train_file(path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return Training(load_train_file(TINY), folder).train(), folder


@pytest.mark.slow
def test_a_training_killed_after_a_checkpoint_ends_with_the_same_weights(whole, tmp_path):
    trained, folder = whole
    killed, found = tmp_path / "killed", tmp_path / "found"

    # A process that is killed leaves what was in its folder then: round 3 is lost.
    def kill(figures, last):
        if figures["round"] == 3:
            shutil.copytree(killed, found)
            raise KeyboardInterrupt

    file = train_file(tmp_path, checkpoint_every=("checkpoint_every: 1", "checkpoint_every: 2"))
    with pytest.raises(KeyboardInterrupt):
        Training(file, killed, show=kill).train()
    for left, n in ((found, 2), (killed, 3)):
        again = Training(file, left, is_resumed=True)
        assert again.n_done == n
        resumed = again.train()
        assert resumed.curves == trained.curves
        for name, array in load_policy(folder / POLICY_FILE).arrays.items():
            assert np.array_equal(load_policy(left / POLICY_FILE).arrays[name], array)


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ("seed: 1", "seed: 1\ncolour: red", "colour"),
        ("kind: ctrnn", "kind: magic", "magic"),
        ("n_neurons: 3", "n_neurons: 0", "n_neurons"),
        ("family: open_halls", "family: nowhere", "expected a family file or a bundled family"),
        ("seed: 1", "seed: 1\nflying: fast", "flying"),
        (
            "{kind: ctrnn, rounds: 4, population: 4, cases_per_round: 4, n_neurons: 3}",
            "{kind: method, method: e_coli, ranges: {}}\nflying: first_order",
            "flying: expected none with a trainer of a method",
        ),
    ],
)
def test_a_wrong_train_file_is_reported_by_its_place(tmp_path, before, after, expected):
    with pytest.raises(ScenarioError) as error:
        train_file(tmp_path, change=(before, after))
    assert expected in str(error.value)


def write_family_of_quadrotors(folder):
    seeds = "seeds: {training: {first: 1, count: 9}, validation: {first: 20, count: 9}, test: {first: 40, count: 9}}"
    gas = "set: {gas.model: gaussian_plume}"
    text = f"schema: gslcosim/family/1\nname: f\nscenario: tiny_room\n{gas}\n{seeds}\n"
    (folder / "family.yaml").write_text(text)


def test_a_family_that_cannot_be_batched_is_reported(tmp_path):
    write_family_of_quadrotors(tmp_path)
    file = train_file(tmp_path, family=("family: open_halls", "family: family.yaml"))
    words = (
        r"family.yaml: seed 1: .* for trainer.kind: ctrnn. agents\[0\].vehicle.model: expected holonomic in a batch, or"
    )
    with pytest.raises(UsageError, match=words):
        Training(file, tmp_path / "out", tell=lambda what, *_: what.startswith("cases") or pytest.fail(what))


def test_a_recipe_of_obstacles_that_cannot_be_batched_is_reported_before_any_wind_is_solved(tmp_path):
    text = bundled_families()["cluttered_halls"].read_text()
    (tmp_path / "hall.yaml").write_text(bundled_families()["cluttered_halls"].with_name("hall.yaml").read_text())
    (tmp_path / "family.yaml").write_text(text.replace("vary:", "set:\n  agents[0].vehicle.avoidance: 2d\nvary:"))
    file = train_file(tmp_path, family=("family: open_halls", "family: family.yaml"))
    with pytest.raises(UsageError, match=r"seed 100000: .* agents\[0\].vehicle.avoidance: expected none in a batch"):
        Training(file, tmp_path / "out", tell=lambda what, *_: what.startswith("cases") or pytest.fail(what))


def test_doping_for_a_family_without_is_reported(tmp_path):
    seeds = "seeds: {training: {first: 1, count: 9}, validation: {first: 20, count: 9}, test: {first: 40, count: 9}}"
    (tmp_path / "family.yaml").write_text(f"schema: gslcosim/family/1\nname: f\nscenario: tiny_room\n{seeds}\n")
    changes = {
        "family": ("family: open_halls", "family: family.yaml"),
        "doping": ("seed: 1", "seed: 1\ndoping: false"),
    }
    with pytest.raises(ScenarioError, match="doping: expected nothing with the family f, which has no doping, was fal"):
        train_file(tmp_path, **changes)


@pytest.mark.slow
def test_a_train_file_that_says_so_trains_with_quadrotors(tmp_path):
    write_family_of_quadrotors(tmp_path)
    family = ("family: open_halls", "family: family.yaml\nflying: first_order")
    file = train_file(tmp_path, family=family, seed=("seed: 1", "seed: 3"))
    trained = Training(file, tmp_path / "out").train(rounds=1)
    assert trained.curves[0]["steps"] > 100


def test_a_name_that_is_not_observed_is_reported(tmp_path):
    file = train_file(tmp_path, names=("n_neurons: 3", "n_neurons: 3, observations: [smell]"))
    with pytest.raises(UsageError, match=r"trainer.observations: expected names among x, y.*was smell"):
        Training(file, tmp_path / "out")


@pytest.mark.slow
def test_the_command_leaves_a_policy_curves_and_a_recording(tmp_path, capsys):
    folder = tmp_path / "out"
    assert main(["train", TINY, "--out", str(folder), "--rounds", "2", "--record", "1", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["rounds"], printed["is_over"]) == (2, False)
    assert (Path(printed["runs"][0]) / "recording.rrd").stat().st_size > 0
    assert (folder / "curves.svg").is_file()
    assert main(["train", TINY, "--out", str(folder), "--resume", "--record", "0"]) == 0
    assert "4 rounds" in capsys.readouterr().out


@pytest.mark.slow
def test_a_table_resumed_ends_with_the_same_values(tmp_path):
    table = "kind: table, rounds: 2, searches: 8, steps_per_round: 12}"
    changes = {
        "trainer": ("kind: ctrnn, rounds: 4, population: 4, cases_per_round: 4, n_neurons: 3}", table),
        "action": ("{kind: velocity, speed_m_s: 0.8, hold_s: 1}", "{kind: heading, step_m: 1, hold_s: 0}"),
    }
    file = train_file(tmp_path, **changes)
    whole = Training(file, tmp_path / "whole").train()
    Training(file, tmp_path / "half").train(rounds=1)
    resumed = Training(file, tmp_path / "half", is_resumed=True).train()
    assert resumed.curves == whole.curves
    assert all(0 <= each["success"] <= 1 for each in whole.curves)
    assert np.array_equal(resumed.best.values, whole.best.values)


@pytest.mark.slow
@pytest.mark.tour
@pytest.mark.extras
def test_recurrent_ppo_draws_hard_cases_more_often_and_goes_on_to_the_same_bits(tmp_path):
    trainer = (
        "{kind: recurrent_ppo, searches: 8, settings: {rounds: 3, horizon: 64, segments: 3, epochs: 1, parts: 2, "
        "n_encoded: 4, n_units: 4}}"
    )
    changes = {
        "trainer": ("{kind: ctrnn, rounds: 4, population: 4, cases_per_round: 4, n_neurons: 3}", trainer),
        "cases": ("training: 4", "training: 6"),
    }
    file = train_file(tmp_path, **changes)
    whole = Training(file, tmp_path / "whole").train()
    Training(file, tmp_path / "half").train(rounds=1)
    half = Training(file, tmp_path / "half", is_resumed=True)
    costs = half.trainer.state()["case_costs"]
    assert np.nanmax(costs) > np.nanmin(costs)
    resumed = half.train()
    assert resumed.curves == whole.curves
    kept = load_costs(tmp_path / "whole")
    assert np.array_equal(half.trainer.state()["case_costs"], kept, equal_nan=True)
    for name, array in whole.best.arrays.items():
        assert np.array_equal(resumed.best.arrays[name], array), name
    evenly = train_file(tmp_path, **changes, doping=("seed: 1", "seed: 1\ndoping: false"))
    other = Training(evenly, tmp_path / "evenly").train(rounds=2)
    # The first round knows no costs yet, and without doping it draws otherwise; nor does a checkpoint hold any.
    assert other.curves[1] != whole.curves[1]
    with np.load(tmp_path / "evenly" / CHECKPOINT) as left:
        assert "trainer.case_costs" not in left.files


@pytest.mark.slow
def test_a_family_with_obstacles_has_winds_and_tapes_made_once_with_progress(tmp_path):
    """The bundled family with winds of 2 s, so that they are made soon."""
    bundled = bundled_families()["cluttered_halls"]
    (tmp_path / "hall.yaml").write_text(bundled.with_name("hall.yaml").read_text())
    short = "set:\n  wind.end_time_s: 2\n  wind.average_from_s: 1\nvary:"
    (tmp_path / "family.yaml").write_text(bundled.read_text().replace("vary:", short))
    observed = ", observations: [nose_ppm.amount, ranges.closeness_0]"
    changes = {
        "family": ("family: open_halls", "family: family.yaml"),
        "names": ("n_neurons: 3", f"n_neurons: 3{observed}"),
        "cases": ("{training: 4, validation: 3}", "{training: 3, validation: 2}"),
        "rounds": ("rounds: 4", "rounds: 1"),
    }
    file, reports = train_file(tmp_path, **changes), []
    training = Training(file, tmp_path / "out", tell=lambda *what: reports.append(what))
    assert ("tapes of training", 3, 3) in reports
    assert ("searches of validation", 2, 2) in reports
    n_rooms = max(total for what, _, total in reports if what == "rooms of training")
    assert 1 <= n_rooms <= 3
    assert training.train().curves[0]["round"] == 1
    before = made_at(training)
    assert made_at(Training(file, tmp_path / "other")) == before


def made_at(training):
    """The files of each environment and when they were written; the folder's own times change with each use."""
    folders = [prepare_environment(case.scenario, scenario_dir=case.directory) for case in training.validation_cases]
    return [{file: file.stat().st_mtime_ns for file in folder.rglob("*") if file.is_file()} for folder in folders]


def load_costs(folder):
    with np.load(folder / CHECKPOINT) as left:
        return left["trainer.case_costs"]


METHOD_FILE = """
schema: gslcosim/train/1
name: tiny_method
family: family.yaml
trainer:
  kind: method
  method: s_pso
  robots: 3
  ranges: {inertia: [0, 1], leg_m: [0.3, 3]}
  rounds: 2
  population: 4
  cases_per_round: 2
cases: {training: 2, validation: 1}
validate_every: 1
checkpoint_every: 1
"""


@pytest.fixture
def method_file(tmp_path):
    """A training of two parameters of a swarm, in halls of which a search lasts 15 s."""
    family = bundled_families()["open_halls"]
    text = family.read_text().replace(
        "scenario: hall.yaml", "scenario: hall.yaml\nset: {referee.stop.time_limit_s: 15}"
    )
    (tmp_path / "family.yaml").write_text(text)
    shutil.copy(family.with_name("hall.yaml"), tmp_path / "hall.yaml")
    path = tmp_path / "method.yaml"
    path.write_text(METHOD_FILE)
    return path


@pytest.mark.slow
def test_parameters_of_a_method_resumed_are_the_same(method_file, tmp_path, capsys):
    file = load_train_file(method_file)
    whole = Training(file, tmp_path / "whole").train()
    call = ["train", str(method_file), "--out", str(tmp_path / "half")]
    assert main([*call, "--rounds", "1", "--record", "1", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (Path(printed["runs"][0]) / "recording.rrd").stat().st_size > 0
    assert main([*call, "--resume", "--record", "0", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["figures"] == whole.curves[-1]
    cards = [json.loads((tmp_path / each / PARAMETERS_FILE).read_text()) for each in ("whole", "half")]
    assert cards[0]["parameters"] == cards[1]["parameters"] == whole.best.parameters
    assert load_parameters(tmp_path / "whole" / PARAMETERS_FILE) == whole.best.parameters
    assert cards[0]["method"] == "s_pso"
    assert cards[0]["budget"] == {"round": 2, "flights": 16}
    assert cards[1]["command"] == f"gslcosim train {method_file}"
    assert (tmp_path / "half" / "curves.svg").is_file()


def test_an_action_of_a_method_is_refused(method_file):
    method_file.write_text(f"{METHOD_FILE}action: {{kind: velocity}}\n")
    with pytest.raises(ScenarioError, match=r"action: expected none for trainer\.kind: method"):
        load_train_file(method_file)
