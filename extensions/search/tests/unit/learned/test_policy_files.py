import json
from types import SimpleNamespace

import numpy as np
import pytest
from policies import EVERY_KIND, NAMES, ctrnn, gru, seen, table

from gslcosim.base.errors import MethodError, UsageError
from gslcosim_search.learned.policy import PolicyError
from gslcosim_search.learned.policy_files import (
    CARD,
    PARAMETERS_FILE,
    load_parameters,
    load_policy,
    read_policy_card,
    save_parameters,
    save_policy,
    with_learned_parameters,
)

PARAMETERS = {"inertia": 0.271, "patience": 12}


def changed(path, *, new_card=None, drop=(), **arrays):
    """Write a file again with changes."""
    with np.load(path) as file:
        entries = {name: file[name] for name in file.files if name not in drop}
    if new_card is not None:
        entries[CARD] = np.array(json.dumps({**json.loads(str(entries[CARD])), **new_card}))
    np.savez(path, **{**entries, **arrays})
    return path


@pytest.mark.parametrize("make", EVERY_KIND.values(), ids=EVERY_KIND)
def test_a_saved_policy_acts_as_before_and_keeps_its_card(make, tmp_path):
    policy = make()
    save_policy(tmp_path / "new" / "p.npz", policy, {"seed": 3, "command": "gslcosim train x.yaml"})
    again = load_policy(tmp_path / "new" / "p.npz")
    assert (again.observation_names, again.action) == (policy.observation_names, policy.action)
    memory = policy.memory(4), again.memory(4)
    for one in seen(4, 5):
        before, first = policy.act(one, memory[0])
        after, second = again.act(one, memory[1])
        assert np.array_equal(before, after)
        assert np.array_equal(first, second, equal_nan=True)
        memory = first, second
    card = read_policy_card(tmp_path / "new" / "p.npz")
    assert (card["seed"], card["kind"], tuple(card["observation_names"])) == (3, policy.kind, NAMES)


def test_the_same_policy_makes_the_same_bytes(tmp_path):
    for name in ("a.npz", "b.npz"):
        save_policy(tmp_path / name, gru(), {"seed": 1})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_a_corrupt_file_is_reported_and_runs_nothing(tmp_path):
    path = tmp_path / "p.npz"
    with pytest.raises(PolicyError, match=r"expected the file of a policy, was none there\.\nFile: .*p\.npz"):
        load_policy(path)
    save_policy(path, gru(), {})
    whole = path.read_bytes()
    for bad in (b"", b"not a zip", whole[: len(whole) // 2], whole[:200] + bytes(100) + whole[300:]):
        path.write_bytes(bad)
        with pytest.raises(PolicyError, match=r"File: .*p\.npz"):
            load_policy(path)
    np.savez(path, card=np.array([{"a": 1}], dtype=object))
    with pytest.raises(PolicyError, match="can be read, got: Object arrays cannot be loaded"):
        load_policy(path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"drop": ("gates",)}, "gates: expected an array, was missing. It has encoder"),
        ({"drop": (CARD,)}, "card: expected an entry, was missing"),
        ({"gates": np.zeros((15, 7))}, r"gates: expected numbers of shape \(15, 8\), was float64 of shape \(15, 7\)"),
        ({"gates": np.full((15, 8), np.nan)}, "gates: expected finite numbers, was 120 that are not"),
        ({"gates": np.full((15, 8), "a")}, "gates: expected numbers"),
        (
            {"new_card": {"schema": "gslcosim/policy/9"}},
            "card.schema: expected gslcosim/policy/1, was 'gslcosim/policy/9'",
        ),
        ({"new_card": {"kind": "lstm"}}, "card.kind: expected one of ctrnn, gru, table, was 'lstm'"),
        ({"new_card": {"observation_names": ["x"]}}, r"encoder: expected numbers of shape \(any, 1\)"),
        ({"new_card": {"observation_names": ["x", "x"]}}, "expected each name once"),
        ({"new_card": {"observation_names": "x"}}, "observation_names: expected a list of names"),
        ({"new_card": {"action": None}}, "action: expected a map with kind, was None"),
        ({"new_card": {"action": {"kind": "velocity_3d"}}}, r"outputs: expected numbers of shape \(3, any\)"),
        ({CARD: np.array("{")}, "card: expected JSON"),
        ({CARD: np.array("[]")}, "card: expected a block, was a list"),
    ],
)
def test_what_is_wrong_with_an_entry_is_reported(tmp_path, changes, words):
    save_policy(tmp_path / "p.npz", gru(), {})
    with pytest.raises(PolicyError, match=words):
        load_policy(changed(tmp_path / "p.npz", **changes))


@pytest.mark.parametrize(
    ("make", "settings", "words"),
    [
        (ctrnn, {"dt_s": 0}, "settings.dt_s: expected a number above 0, was 0"),
        (table, {}, "settings.digits: expected a list of digits"),
        (table, {"digits": [{"digit": "colour"}]}, r"settings.digits\[0\]: expected a digit among level"),
        (table, {"digits": [{"digit": "level", "cuts": [1]}]}, r"digits\[0\]: expected settings of level, got"),
        (table, {"digits": [{"digit": "level", "observation": "refused", "cuts": [1]}]}, r"of shape \(2, 9\)"),
    ],
)  # fmt: skip
def test_wrong_settings_of_a_kind_are_reported(tmp_path, make, settings, words):
    save_policy(tmp_path / "p.npz", make(), {})
    with pytest.raises(PolicyError, match=words):
        load_policy(changed(tmp_path / "p.npz", new_card={"settings": settings}))


def test_what_cannot_be_saved_is_reported(tmp_path):
    with pytest.raises(UsageError, match=r"to end with \.npz, was p\.zip"):
        save_policy(tmp_path / "p.zip", gru(), {})
    with pytest.raises(UsageError, match=r"card: expected other names than schema.*, was kind"):
        save_policy(tmp_path / "p.npz", gru(), {"kind": "x"})
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="expected a file that can be written"):
        save_policy(tmp_path / "file" / "p.npz", gru(), {})


def test_an_agent_gets_them_beside_its_settings(tmp_path):
    save_parameters(tmp_path, "dr_pso", PARAMETERS, {"seeds": [1], "command": "gslcosim train mine.yaml"})
    settings = with_learned_parameters(SimpleNamespace(near_m=1.5), str(tmp_path / "agent.py"))
    assert vars(settings) == {"near_m": 1.5, **PARAMETERS}
    card = json.loads((tmp_path / PARAMETERS_FILE).read_text())
    assert (card["method"], card["command"]) == ("dr_pso", "gslcosim train mine.yaml")


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"schema": "gslcosim/parameters/2", "parameters": {}}'])
def test_what_is_no_file_of_parameters_is_reported(tmp_path, text):
    (tmp_path / PARAMETERS_FILE).write_text(text)
    with pytest.raises(MethodError, match=r"parameters (that|of schema).*\nFile: .*parameters\.json"):
        load_parameters(tmp_path / PARAMETERS_FILE)


def test_a_file_that_is_not_there_is_reported(tmp_path):
    with pytest.raises(
        MethodError, match=r"expected a folder with parameters\.json, found none.*\nFile: .*parameters\.json"
    ):
        load_parameters(tmp_path / PARAMETERS_FILE)
