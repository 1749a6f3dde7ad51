import numpy as np
import pytest
from briefings import briefing, observation

from gslcosim_training.parallel_env import RadioCodec


def test_what_one_sends_the_others_receive():
    (message,) = RadioCodec(briefing(name="a", members="abc"), 2).message([0.25, -1.0])
    hears = RadioCodec(briefing(name="b", members="abc"), 2)
    assert hears.receive(observation()).tolist() == [0.0] * 4
    assert hears.receive(observation(heard=[("a", message.text)])).tolist() == [0.25, -1.0, 0.0, 0.0]
    assert hears.receive(observation()).tolist() == [0.25, -1.0, 0.0, 0.0], "what was heard last stands"


@pytest.mark.parametrize("text", ["come here", "[1]", "[1, 2, 3]", '["x", 1]', "[NaN, 0]", "7", "null", "{}"])
def test_texts_of_others_are_no_numbers(text):
    hears = RadioCodec(briefing(name="b", members="ab"), 2)
    assert hears.receive(observation(heard=[("a", text)])).tolist() == [0.0, 0.0]


def test_numbers_stay_within_one():
    hears = RadioCodec(briefing(name="b", members="ab"), 1)
    np.testing.assert_array_equal(hears.receive(observation(heard=[("a", "[7]")])), [1.0])
