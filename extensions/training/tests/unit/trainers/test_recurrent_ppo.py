"""Recurrent PPO learns, is the policy that it exports, and goes on to the same bits after an interruption."""

import builtins

import numpy as np
import pytest
from toy_hall import NAMES, ToyHall

from gslcosim.base.errors import UsageError
from gslcosim_search.learned.policy import ActionSettings
from gslcosim_training.trainers.recurrent_ppo import PpoSettings, RecurrentPpo, advantages, forward, load_jax

pytestmark = pytest.mark.extras

QUICK = {"rounds": 3, "horizon": 16, "segments": 2, "epochs": 2, "parts": 2, "n_encoded": 8, "n_units": 8}
VELOCITY = ActionSettings(kind="velocity")
HEADING = ActionSettings(kind="heading")


def trainer(*, n_envs=8, action=VELOCITY, seed=1, env=None, **settings):
    envs = ToyHall(n_envs, choices=action is HEADING, **(env or {}))
    ppo_settings = PpoSettings(**{**QUICK, **settings})
    return RecurrentPpo(envs, observation_names=NAMES, action=action, settings=ppo_settings, seed=seed)


def arrays_of(one):
    return one.policy().arrays


@pytest.mark.slow
@pytest.mark.parametrize("action", [VELOCITY, HEADING], ids=lambda action: action.kind)
def test_the_exported_policy_acts_as_the_network_that_was_trained(action):
    jax, _ = load_jax()
    one = trainer(action=action)
    one.step()
    policy = one.policy()
    assert policy.spread == pytest.approx(0.6 if action is VELOCITY else 0.0, abs=0.03)
    observed = np.random.default_rng(4).uniform(-1, 1, (40, 8, 4)).astype(np.float32)
    starts = np.random.default_rng(5).uniform(size=(40, 8)) < 0.1
    outputs, _ = forward(jax, one._arrays, observed, starts, np.zeros((8, 8), np.float32))
    memory = policy.memory(8)
    for t in range(40):
        memory = np.where(starts[t][:, None], np.float32(0.0), memory)
        flown, memory = policy.outputs(observed[t], memory)
        np.testing.assert_allclose(action.chosen(flown), action.chosen(np.array(outputs[t])), atol=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("resets", ["same", "next"])
def test_the_same_seed_learns_the_same_and_another_does_not(resets):
    first, second, other = (trainer(seed=seed, env={"resets": resets}) for seed in (1, 1, 2))
    for one in (first, second, other):
        one.step()
        one.step()
    assert all(np.array_equal(array, arrays_of(second)[name]) for name, array in arrays_of(first).items())
    assert not np.array_equal(arrays_of(first)["gates"], arrays_of(other)["gates"])


@pytest.mark.slow
@pytest.mark.tour
def test_a_training_that_was_interrupted_ends_with_the_same_bits():
    whole = trainer()
    figures = [whole.step() for _ in range(3)]
    assert whole.is_over
    half = trainer()
    half.step()
    again = trainer(seed=1)
    again.resume(half.state())
    assert [again.step(), again.step()] == figures[1:]
    for name, array in whole.state().items():
        assert np.array_equal(array, again.state()[name]), name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("action", "env"),
    [(VELOCITY, {"resets": "next", "hides_wind": True}), (HEADING, {})],
    ids=["remembers_the_wind", "choices"],
)
def test_it_learns_to_go_upwind(action, env):
    """Where the wind is seen once it has to be remembered; the figures are those of the exported policy."""
    one = trainer(n_envs=64, action=action, env=env, rounds=60, horizon=32, learning_rate=3e-3)
    first = one.step()["success"]
    while not one.is_over:
        one.step()
    envs, policy = ToyHall(64, choices=action is HEADING, hides_wind=bool(env)), one.policy()
    observed, _ = envs.reset(seed=99)
    memory, found, is_first = policy.memory(64), np.zeros(64, bool), np.ones(64, bool)
    for _ in range(30):
        actions, memory = policy.act(observed, memory)
        observed, _, success, truncated, _ = envs.step(actions)
        found |= success & is_first
        is_first &= ~(success | truncated)
        memory[success | truncated] = 0.0
    assert found.mean() > 0.9 > first


def test_advantages_are_the_sum_that_they_should_be():
    rng = np.random.default_rng(1)
    rewards, values = rng.normal(size=(6, 2)), rng.normal(size=(7, 2))
    ends = np.zeros((6, 2), bool)
    ends[3, 0] = True
    found = advantages(rewards, values, ends, discount=0.9, trace=0.8)
    change = rewards + 0.9 * values[1:] * ~ends - values[:-1]
    assert found[1, 1] == pytest.approx(sum((0.9 * 0.8) ** i * change[1 + i, 1] for i in range(5)))
    assert found[1, 0] == pytest.approx(sum((0.9 * 0.8) ** i * change[1 + i, 0] for i in range(3)))


class _Remembers(ToyHall):
    """The toy, which keeps what it has paid and which searches it has cut off."""

    def reset(self, **settings):
        self.paid, self.cut_off = [], []
        return super().reset(**settings)

    def step(self, actions):
        told = super().step(actions)
        self.paid.append(told[1])
        self.cut_off.append(told[3])
        return told


@pytest.mark.parametrize("resets", ["next", "same"])
def test_a_time_limit_cuts_a_search_off_and_is_not_its_end(resets):
    """Its last reward has the value of what would have come, that of the last observation and memory."""
    envs = _Remembers(8, resets=resets)
    settings = PpoSettings(**{**QUICK, "horizon": 31, "segments": 1, "epochs": 1})
    one = RecurrentPpo(envs, observation_names=NAMES, action=VELOCITY, settings=settings, seed=1)
    flown, arrays = [], dict(one._arrays)
    learn = one._learn
    one._learn = lambda segments, rng: flown.append(segments) or learn(segments, rng)
    one.step()
    (segments,) = flown
    cut_off, paid = np.stack(envs.cut_off), np.stack(envs.paid)
    assert cut_off[29].any()
    assert not cut_off[:29].any()
    added = segments.rewards - paid
    np.testing.assert_array_equal(np.abs(added) > 1e-6, cut_off)
    # The same searches, by the network of the loss: in the next step the last observation stands before the new search.
    other = _Remembers(8, resets="next")
    after = RecurrentPpo(other, observation_names=NAMES, action=VELOCITY, settings=settings, seed=1)
    after._learn = lambda segments, rng: flown.append(segments) or [{"policy_loss": 0.0}]
    after.step()
    values = np.array(after._values_of(arrays, flown[1].observed, flown[1].starts, flown[1].memory))
    np.testing.assert_allclose(added[29][cut_off[29]], 0.99 * values[30][cut_off[29]], atol=2e-5)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"rounds": 0}, "recurrent_ppo.rounds: expected a whole number from 1, was 0"),
        ({"discount": 1.5}, "recurrent_ppo.discount: expected a number above 0 and up to 1, was 1.5"),
        ({"max_gradient": "much"}, "recurrent_ppo.max_gradient: expected a number from 0, was 'much'"),
        ({"collision_cost": -1.0}, "recurrent_ppo.collision_cost: expected a number from 0, was -1.0"),
        ({"parts": 3}, "recurrent_ppo.parts: expected a divisor of 8 environments, was 3"),
        ({"observations": ("x", "smell")}, "recurrent_ppo.observations: expected names among x, y, .*, was smell"),
    ],
)
def test_wrong_settings_are_reported(settings, words):
    with pytest.raises(UsageError, match=words):
        trainer(**settings)


def test_a_checkpoint_of_another_network_is_refused_and_nothing_is_lost():
    one, other = trainer(), trainer(n_units=4)
    before = {name: array.copy() for name, array in one.state().items()}
    with pytest.raises(UsageError, match="checkpoint: expected the arrays of a network of 8 units, was other ones in"):
        one.resume(other.state())
    assert all(np.array_equal(array, before[name]) for name, array in one.state().items())


@pytest.mark.parametrize("is_final", [False, True], ids=["next_step", "same_step"])
def test_a_search_that_ends_by_a_collision_costs_what_is_set(is_final):
    ppo_settings = {"outcome": np.array(["collision", "success", None, "collision"], dtype=object)}
    ends = np.array([True, True, False, False])
    one = trainer(collision_cost=1.5)
    np.testing.assert_array_equal(
        one._cost_of_ends({"final_info": ppo_settings} if is_final else ppo_settings, ends), [1.5, 0, 0, 0]
    )
    assert trainer()._cost_of_ends(ppo_settings, ends) == 0.0


def test_without_jax_the_command_that_installs_it_is_reported(monkeypatch):
    imported = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "jax":
            raise ModuleNotFoundError("No module named 'jax'", name="jax")
        return imported(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UsageError, match=r"needs jax, .* Install it: pip install 'gslcosim-training\[train\]'"):
        load_jax()
