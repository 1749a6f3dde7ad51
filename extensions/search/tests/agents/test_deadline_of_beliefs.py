"""Every bundled method that keeps a belief takes note of gas on its way, for the declaration at the time limit."""

import numpy as np
import pytest
from briefings import MODELS, observation, task_of
from test_every_method import SOURCE_M, START_M, Air, briefing_for, card_of, picture, sensors_for, type_of

from gslcosim.base.bundled import bundled_agents
from gslcosim.scenario.models.success import DeclarationSuccess, SourceSuccess

BELIEVING = [name for name in sorted(bundled_agents()) if (card := card_of(name)) is not None and card.believes]


def built(name, success=None, **parameters):
    card = card_of(name)
    return type_of(name)(briefing_for(card, task=task_of(success or DeclarationSuccess()), parameters=parameters))


@pytest.mark.parametrize("name", BELIEVING)
def test_a_belief_that_met_gas_is_declared_late_and_one_that_met_none_is_not(name):
    made = built(name)
    p = np.zeros(made.grid.shape)
    p[tuple(n // 2 for n in p.shape)] = 1.0
    assert made.deadline.estimate(299.0, p, made.grid) is None
    sensors = sensors_for(card_of(name))
    cameras = [each for model, each, *_ in sensors if MODELS[model][0] == "picture"]
    for tick in range(1, 4):
        seen = observation(tick=tick, position_m=START_M, readings=Air(sensors).readings(SOURCE_M))
        made.observe(picture(seen, cameras))
    assert made.deadline.estimate(299.0, p, made.grid) is not None


def test_the_rule_is_off_where_it_is_said_so_or_nothing_is_asked_for():
    assert built("infotaxis", deadline="never").deadline is None
    assert built("infotaxis", SourceSuccess()).deadline is None
