import subprocess
import sys

import numpy as np
import pytest

from gslcosim.base.rng import stream

NAMES = ["fields.release", "fields.disperse", "sensing.nose", "sensing.nosf", ""]


def test_a_stream_is_repeatable():
    assert np.array_equal(stream(7, "fields.release").random(8), stream(7, "fields.release").random(8))


def test_streams_differ_by_seed_and_by_name():
    first_draws = {float(stream(seed, name).random()) for seed in range(50) for name in NAMES}
    assert len(first_draws) == 50 * len(NAMES)


def test_a_stream_does_not_depend_on_what_others_drew():
    other = stream(7, "fields.disperse")
    mine = stream(7, "fields.release")
    first = mine.random()
    other.random(1000)
    assert [first, mine.random()] == stream(7, "fields.release").random(2).tolist()


@pytest.mark.slow
def test_a_stream_is_the_same_in_another_process():
    """Python salts its own hash of strings for each process; streams must not use it."""
    code = "from gslcosim.base.rng import stream; print(stream(7, 'fields.release').integers(2**62))"
    answers = {
        subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONHASHSEED": salt}, capture_output=True, text=True, check=True
        ).stdout
        for salt in ("1", "2")
    }
    assert answers == {f"{stream(7, 'fields.release').integers(2**62)}\n"}
