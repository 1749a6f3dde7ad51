"""Small policies of each kind for tests, with numbers drawn from a seed."""

import numpy as np

from gslcosim_search.learned.policy import ActionSettings
from gslcosim_search.learned.recurrent_networks import CtrnnPolicy, GruPolicy
from gslcosim_search.learned.value_table import ChangeFeature, LevelFeature, SectorFeature, SinceFeature, ValueTable

NAMES = ("refused", "nose.amount", "wind.from_sin", "wind.from_cos")
VELOCITY = ActionSettings(kind="velocity", speed_m_s=0.5, hold_s=0.5)
HEADING = ActionSettings(kind="heading", step_m=0.5, hold_s=0.0)


def drawn(rng, *shape):
    return rng.normal(0.0, 0.7, shape).astype(np.float32)


def ctrnn(action=VELOCITY, h=6, names=NAMES, spread=0.0):
    rng = np.random.default_rng(1)
    arrays = {
        "tau_s": rng.uniform(0.5, 5.0, h).astype(np.float32), "recurrent": drawn(rng, h, h), "bias": drawn(rng, h),
        "inputs": drawn(rng, h, len(names)), "outputs": drawn(rng, action.n_outputs, h),
        "output_bias": drawn(rng, action.n_outputs),
    }  # fmt: skip
    return CtrnnPolicy(names, action, dt_s=0.5, spread=spread, **arrays)


def gru(action=VELOCITY, m=8, h=5, names=NAMES):
    rng = np.random.default_rng(2)
    return GruPolicy(
        names, action, encoder=drawn(rng, m, len(names)), encoder_bias=drawn(rng, m), gates=drawn(rng, 3 * h, m),
        gates_bias=drawn(rng, 3 * h), recurrent_gates=drawn(rng, 3 * h, h), recurrent_bias=drawn(rng, 3 * h),
        outputs=drawn(rng, action.n_outputs, h), output_bias=drawn(rng, action.n_outputs),
    )  # fmt: skip


def table(names=NAMES):
    digits = [
        LevelFeature(observation="refused", cuts=(0.5,)),
        SinceFeature(observation="nose.amount", above=0.1, cuts=(1.0, 4.0)),
        ChangeFeature(observation="nose.amount", cuts=(-0.01, 0.01)),
        SectorFeature(sin="wind.from_sin", cos="wind.from_cos", n_sectors=4),
    ]
    values = drawn(np.random.default_rng(3), 2 * 3 * 3 * 4, 9)
    return ValueTable(names, HEADING, digits=digits, values=values, turns_with=("wind.from_sin", "wind.from_cos"))


EVERY_KIND = {
    "ctrnn": ctrnn, "gru": gru, "table": table, "gru_of_choices": lambda: gru(HEADING),
    "ctrnn_with_spread": lambda: ctrnn(spread=0.4),
}  # fmt: skip


def seen(n, n_steps, names=NAMES, seed=5):
    """Return what n agents see, (steps, n, k)."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (n_steps, n, len(names))).astype(np.float32)
