import math

import numpy as np
import pytest
from policies import EVERY_KIND, HEADING, NAMES, VELOCITY, ctrnn, gru, seen, table

from gslcosim_search.learned.policy import ActionSettings, PolicyError, normal_numbers
from gslcosim_search.learned.recurrent_networks import GruPolicy
from gslcosim_search.learned.value_table import LevelFeature, ValueTable, WindPositionFeature

every_kind = pytest.mark.parametrize("make", EVERY_KIND.values(), ids=EVERY_KIND)


def flown(policy, observations):
    """Return the actions (steps, n, ...) and the last memory."""
    memory, actions = policy.memory(observations.shape[1]), []
    for one in observations:
        chosen, memory = policy.act(one, memory)
        actions.append(chosen)
    return np.stack(actions), memory


@every_kind
def test_one_agent_acts_as_it_does_among_many(make):
    policy, observations = make(), seen(7, 20)
    together, memory = flown(policy, observations)
    for i in range(7):
        alone, own = flown(policy, observations[:, i : i + 1])
        np.testing.assert_allclose(alone[:, 0], together[:, i], atol=1e-5)
        np.testing.assert_allclose(own[0], memory[i], atol=1e-5)


@every_kind
def test_acting_changes_nothing_that_was_given(make):
    policy, (observations, *_) = make(), seen(3, 1)
    memory = policy.memory(3)
    before, kept = memory.copy(), observations.copy()
    policy.act(observations, memory)
    assert np.array_equal(memory, before)
    assert np.array_equal(observations, kept)


def test_a_neuron_without_connections_relaxes_with_its_time_constant():
    policy = ctrnn(h=1)
    for name in ("recurrent", "inputs"):
        policy.arrays[name][:] = 0.0
    policy = type(policy).of_arrays(NAMES, VELOCITY, policy.arrays, policy.settings)
    memory = np.ones((1, 1), np.float32)
    for _ in range(3):
        _, memory = policy.act(np.zeros((1, 4), np.float32), memory)
    assert memory[0, 0] == pytest.approx(math.exp(-3 * 0.5 / float(policy.arrays["tau_s"][0])), rel=1e-5)


def test_a_gru_is_what_the_equations_say():
    policy, observation = gru(), seen(1, 1)[0]
    a = {name: array.astype(np.float64) for name, array in policy.arrays.items()}
    h = np.full(5, 0.3)
    e = np.tanh(a["encoder"] @ observation[0] + a["encoder_bias"])
    (ri, zi, ni), (rh, zh, nh) = (
        np.split(a["gates"] @ e + a["gates_bias"], 3),
        np.split(a["recurrent_gates"] @ h + a["recurrent_bias"], 3),
    )
    r, z = (1 / (1 + np.exp(-u)) for u in (ri + rh, zi + zh))
    n = np.tanh(ni + r * nh)
    after = (1 - z) * n + z * h
    actions, memory = policy.act(observation, np.full((1, 5), 0.3, np.float32))
    np.testing.assert_allclose(memory[0], after, atol=1e-6)
    np.testing.assert_allclose(actions[0], np.tanh(a["outputs"] @ after + a["output_bias"]), atol=1e-6)


def test_a_table_looks_up_the_state_that_its_digits_make():
    policy = table()
    memory = policy.memory(1)
    # refused, gas now, first amount (no change), wind from +y: the second of four sectors.
    (state,), memory = policy.states(np.array([[1.0, 0.5, 1.0, 0.0]], np.float32), memory)
    assert state == ((1 * 3 + 0) * 3 + 1) * 4 + 1
    # no longer refused, less gas and none for one question, wind from -x.
    (state,), memory = policy.states(np.array([[0.0, 0.0, 0.0, -1.0]], np.float32), memory)
    assert state == ((0 * 3 + 1) * 3 + 0) * 4 + 2
    for _ in range(3):
        (state,), memory = policy.states(np.array([[0.0, 0.0, 0.0, -1.0]], np.float32), memory)
    assert state == ((0 * 3 + 2) * 3 + 1) * 4 + 2


def test_a_place_is_seen_upwind_whatever_the_wind():
    """A quarter of the room ahead and to the left of the middle is the same class in each of the eight winds."""
    digit = WindPositionFeature(x="x", y="y", sin="sin", cos="cos", cuts=(0.0, 0.9))
    angles = 2 * np.pi * np.arange(8) / 8
    x, y = 0.5 * np.cos(angles) - 0.4 * np.sin(angles), 0.5 * np.sin(angles) + 0.4 * np.cos(angles)
    seen = [part.astype(np.float32) for part in (x, y, np.sin(angles + 0.2), np.cos(angles + 0.2))]
    classes, _ = digit.classes(seen, np.zeros(8, np.float32))
    assert classes.tolist() == [1 * 3 + 1] * 8
    behind, _ = digit.classes([-seen[0], -seen[1], *seen[2:]], np.zeros(8, np.float32))
    assert behind.tolist() == [0] * 8
    assert digit.n_classes == 9


def test_headings_of_a_table_turn_with_the_wind_and_to_hold_does_not():
    values = np.zeros((2, 9), np.float32)
    values[0, 1], values[1, 8] = 1.0, 1.0  # 45 degrees left of upwind; to hold where the last was refused
    policy = ValueTable(NAMES, HEADING, digits=[LevelFeature(observation="refused", cuts=(0.5,))], values=values,
                        turns_with=("wind.from_sin", "wind.from_cos"))  # fmt: skip
    wind = [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, -1.0], [1.0, 0.0, 1.0, 0.0]]
    actions, _ = policy.act(np.array(wind, np.float32), policy.memory(4))
    assert actions.tolist() == [1, 3, 5, 8]


def test_after_each_refusal_the_next_best_choice_follows():
    values = np.array([[0.1, 0.5, 0.3, *[0.0] * 6]], np.float32)
    policy = ValueTable(NAMES, HEADING, digits=[LevelFeature(observation="nose.amount", cuts=())], values=values,
                        yields_with="refused")  # fmt: skip
    memory, chosen = policy.memory(1), []
    for is_refused in (0, 1, 1, 1, 0, 1):
        actions, memory = policy.act(np.array([[is_refused, 0, 0, 1]], np.float32), memory)
        chosen.append(int(actions[0]))
    assert chosen == [1, 2, 0, 3, 1, 2]
    again = ValueTable.of_arrays(NAMES, HEADING, policy.arrays, policy.settings)
    assert again.yields_with == "refused"


def test_a_share_of_choices_is_drawn_by_the_bits_of_what_is_observed():
    values = np.zeros((1, 9), np.float32)
    policy = ValueTable(
        NAMES, HEADING, digits=[LevelFeature(observation="nose.amount", cuts=())], values=values, explores=0.5
    )
    (observations,) = seen(4000, 1)
    actions, _ = policy.act(observations, policy.memory(4000))
    again, _ = policy.act(observations, policy.memory(4000))
    assert np.array_equal(actions, again)
    shares = np.bincount(actions, minlength=9) / 4000
    np.testing.assert_allclose(shares, [0.5 + 0.5 / 9, *[0.5 / 9] * 8], atol=0.03)
    with pytest.raises(PolicyError, match=r"explores: expected a share from 0 to 1, was 2"):
        ValueTable.of_arrays(NAMES, HEADING, policy.arrays, {**policy.settings, "explores": 2})


def test_wrong_settings_are_reported():
    with pytest.raises(PolicyError, match=r"action\.kind: expected one of waypoint.*, was 'jump'"):
        ActionSettings(kind="jump")
    with pytest.raises(PolicyError, match=r"action\.hold_s: expected a number from 0, was -1"):
        ActionSettings(kind="heading", hold_s=-1)
    with pytest.raises(
        PolicyError, match=r"action: expected kind, step_m, speed_m_s, hold_s, frame, shield_m, was pace"
    ):
        ActionSettings.of({"kind": "heading", "pace": 1})
    with pytest.raises(PolicyError, match="expected one with choices"):
        ValueTable(NAMES, VELOCITY, digits=table().digits, values=table().values)
    with pytest.raises(PolicyError, match=r"expected names among observation_names, was vx"):
        ValueTable(
            NAMES, HEADING, digits=[LevelFeature(observation="vx", cuts=(0.5,))], values=np.zeros((2, 9), np.float32)
        )


def test_the_numbers_are_normal_and_apart_from_each_other():
    numbers = normal_numbers(seen(50_000, 1)[0], 3).astype(np.float64)
    assert np.abs(numbers.mean(axis=0)).max() < 0.02
    assert np.abs(np.cov(numbers.T) - np.eye(3)).max() < 0.02
    for limit in (-2.0, -1.0, 0.0, 1.0, 2.0):
        expected = 0.5 * (1 + math.erf(limit / math.sqrt(2)))
        assert abs((numbers < limit).mean() - expected) < 0.005


def spread_of(spread, action=VELOCITY):
    return GruPolicy.of_arrays(NAMES, action, gru(action).arrays, {"spread": spread})


def test_a_policy_with_a_spread_scatters_around_its_mean_and_remembers_the_same():
    mean, scattered, (observed,) = spread_of(0.0), spread_of(0.3), seen(20_000, 1)
    outputs, _ = mean.outputs(observed, mean.memory(len(observed)))
    actions, memory = scattered.act(observed, scattered.memory(len(observed)))
    assert np.std(np.arctanh(actions.astype(np.float64)) - outputs) == pytest.approx(0.3, rel=0.02)
    assert np.array_equal(memory, mean.act(observed, mean.memory(len(observed)))[1])


def test_a_wrong_spread_is_reported():
    with pytest.raises(PolicyError, match=r"settings\.spread: expected a number from 0, was -1"):
        spread_of(-1)
    with pytest.raises(PolicyError, match=r"settings\.spread: expected 0 for action heading, which has choices"):
        spread_of(0.5, HEADING)
