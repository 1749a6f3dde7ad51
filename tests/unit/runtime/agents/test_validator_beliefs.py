"""Which beliefs pass an agent's validator: at most one in a second of simulated time."""

import numpy as np
from built_messages import build_observation

from gslcosim.contract import codec
from gslcosim.contract.messages import Belief, Command
from gslcosim.contract.record import NumericArray
from gslcosim.runtime.agents.validator import CommandValidator

BELIEF = Belief(
    origin_m=(0.0, 0.0, 1.0), cell_m=1.0, probability=NumericArray.from_array(np.full((2, 2), 0.25, np.float32))
)


def question(tick):
    return build_observation(tick, status="on_ground")


def passed(ticks, *, every_ticks=10):
    """Return the validator, and for each tick whether the belief passed with its command."""
    validator, have_belief = CommandValidator("beetle", belief_every_ticks=every_ticks), []
    for tick in ticks:
        validator.on_observation(question(tick))
        (command,) = validator.on_answer(codec.encode(Command(tick=tick, kind="hold", hold_s=0.5, belief=BELIEF)))
        assert (command.kind, command.hold_s) == ("hold", 0.5)
        have_belief.append(command.belief == BELIEF)
    return validator, have_belief


def test_beliefs_a_second_apart_pass():
    validator, have_belief = passed([3, 13, 23])
    assert have_belief == [True, True, True]
    assert validator.faults == []


def test_a_belief_that_comes_sooner_is_left_out_and_reported_while_its_command_counts():
    validator, have_belief = passed([3, 4, 12, 13, 14])
    assert have_belief == [True, False, False, True, False]
    assert len(validator.faults) == 3
    assert "expected at most one in 10 ticks" in validator.faults[0].text
    assert "was the next after 1" in validator.faults[0].text


def test_a_wrong_belief_is_refused_as_any_wrong_command():
    validator = CommandValidator("beetle")
    validator.on_observation(question(1))
    fields = Command(tick=1, kind="hold", belief=BELIEF).model_dump()
    fields["belief"]["probability"]["data"] = np.full((2, 2), 0.5, np.float32).tobytes()
    (command,) = validator.on_answer(codec._msgpack.packb(fields))
    assert (command.kind, command.belief) == ("hold", None)
    assert "belief.probability: " in validator.faults[0].text
    assert "sum is 1, was 2" in validator.faults[0].text
